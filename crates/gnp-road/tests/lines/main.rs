//! Reference lines against roads whose course is known.

mod bad_lines;
mod mapping;
mod roads;
