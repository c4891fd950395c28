//! Training of goals, attraction and repulsion.
