//! Metrics, protocols, bootstrap, score tables and prediction files.
