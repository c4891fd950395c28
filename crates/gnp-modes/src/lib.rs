//! Intention modes: rigidly normalised futures, clustered.
