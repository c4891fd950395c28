//! GNP as one predictor: windows to features, goals, paths and forces; checkpoints.
