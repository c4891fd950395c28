//! Values of arguments that are names.

use clap::ValueEnum;
use gnp::AddedCar;
use gnp_data::limits::MAX_SPEED;
use gnp_data::{Dataset, DatasetNameError, format_of};
use gnp_eval::{FARTHEST_M, Protocol};

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

/// `--dataset`: a dataset whose files can be read.
pub(crate) fn dataset(text: &str) -> Result<Dataset, String> {
    let dataset: Dataset = text.parse().map_err(|error: DatasetNameError| error.to_string())?;
    format_of(dataset).map(|_| dataset).map_err(|error| error.to_string())
}

/// `--goal`: a place forward and left of a vehicle, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place(pub(crate) [f32; 2]);

/// `--goal X,Y`.
pub(crate) fn place(text: &str) -> Result<Place, String> {
    let both = text.split_once(',').and_then(|(x, y)| Some([number(x, FARTHEST_M)?, number(y, FARTHEST_M)?]));
    both.map(Place)
        .ok_or_else(|| format!("give two lengths in m, forward and left, up to {FARTHEST_M}, such as 60,-3.6"))
}

/// `--speed VEHICLE=MPS`.
pub(crate) fn speed(text: &str) -> Result<(String, f32), String> {
    let both = of_vehicle(text).and_then(|(vehicle, speed)| Some((vehicle, number(speed, MAX_SPEED)?)));
    both.ok_or_else(|| format!("give a vehicle and its speed in m/s, up to {MAX_SPEED}, such as 549=5"))
}

/// `--move VEHICLE=DX,DY`.
pub(crate) fn moved(text: &str) -> Result<(String, [f32; 2]), String> {
    let both = of_vehicle(text).and_then(|(vehicle, by)| {
        let (forward, left) = by.split_once(',')?;
        Some((vehicle, [number(forward, FARTHEST_M)?, number(left, FARTHEST_M)?]))
    });
    both.ok_or_else(|| {
        format!("give a vehicle and how far forward and left it is moved, m, up to {FARTHEST_M}, such as 549=-10,3.5")
    })
}

/// Name of a vehicle, which may have the sign in it, and what is said of it.
fn of_vehicle(text: &str) -> Option<(String, &str)> {
    let (vehicle, said) = text.rsplit_once('=')?;
    let vehicle = vehicle.trim();
    (!vehicle.is_empty()).then(|| (vehicle.to_owned(), said))
}

/// `--add X,Y,MPS`.
pub(crate) fn added(text: &str) -> Result<AddedCar, String> {
    let mut parts = text.splitn(3, ',');
    let mut next = |most: f32| number(parts.next()?, most);
    let [x, y, speed_mps] = [next(FARTHEST_M), next(FARTHEST_M), next(MAX_SPEED)];
    match (x, y, speed_mps) {
        (Some(x), Some(y), Some(speed_mps)) => Ok(AddedCar { at: [x, y], speed_mps }),
        _ => Err("give two lengths in m, forward and left, and a speed in m/s, such as 20,-3.5,12".to_owned()),
    }
}

/// A span of time, s: up to a day.
pub(crate) fn seconds(text: &str) -> Result<f64, String> {
    let given = text.trim().parse().ok().filter(|seconds| (0. ..=86_400.).contains(seconds));
    given.ok_or_else(|| "give a number of seconds from 0 to 86400".to_owned())
}

/// A span of time above 0, s: up to a day.
pub(crate) fn positive_seconds(text: &str) -> Result<f64, String> {
    let given = text.trim().parse().ok().filter(|seconds| *seconds > 0. && *seconds <= 86_400.);
    given.ok_or_else(|| "give a number of seconds above 0, up to 86400".to_owned())
}

/// A number that is not larger than `most`, with either sign.
fn number(text: &str, most: f32) -> Option<f32> {
    text.trim().parse().ok().filter(|value: &f32| value.abs() <= most)
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

impl DeviceName {
    /// As typed.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::Metal => "metal",
        }
    }
}
