//! Placeholder until the simulator stands.
fn main() {}
