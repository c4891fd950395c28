//! Goal prediction: a transformer over intention modes.
