//! Values of arguments that are names.

use clap::ValueEnum;
use gnp_data::Dataset;
use gnp_eval::Protocol;

/// `--protocol`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProtocolName {
    /// No future input; top-1 and best of 6.
    Clean,
    /// Top-1 at the instant.
    Literature,
    /// Best of 20, averaged up to the horizon.
    Paper,
    /// Metrics of Argoverse 2.
    Av2,
    /// Metrics of nuScenes.
    Nuscenes,
    /// Metrics of Waymo motion.
    Waymo,
}

impl From<ProtocolName> for Protocol {
    fn from(name: ProtocolName) -> Self {
        match name {
            ProtocolName::Clean => Self::Clean,
            ProtocolName::Literature => Self::Literature,
            ProtocolName::Paper => Self::Paper,
            ProtocolName::Av2 => Self::Argoverse2,
            ProtocolName::Nuscenes => Self::NuScenes,
            ProtocolName::Waymo => Self::Waymo,
        }
    }
}

/// `--dataset`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DatasetName {
    /// US-101 and I-80, 10 Hz; embedded: real scenes.
    Ngsim,
    /// highD, 25 Hz; embedded: simulated recordings in its layout.
    Highd,
}

impl DatasetName {
    /// As on the command line and in file names.
    pub(crate) fn as_str(self) -> &'static str {
        match self {
            Self::Ngsim => "ngsim",
            Self::Highd => "highd",
        }
    }
}

impl From<DatasetName> for Dataset {
    fn from(name: DatasetName) -> Self {
        match name {
            DatasetName::Ngsim => Self::Ngsim,
            DatasetName::Highd => Self::HighD,
        }
    }
}

/// `--device`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DeviceName {
    /// The processor.
    Cpu,
    /// The first NVIDIA GPU.
    Cuda,
    /// The GPU of an Apple computer.
    Metal,
}
