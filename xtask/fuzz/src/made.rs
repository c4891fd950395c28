//! Small parts of made-up cases.

use std::collections::BTreeMap;

use arbitrary::{Arbitrary, Result, Unstructured};
use gnp_data::{
    Dataset, LaneMarking, NeighbourSource, Recording, RecordingMeta, Road, Rows, VehicleBody, VehicleClass,
    WindowConfig,
};

use crate::finding::Finding;

/// A value that is there in one case of sixteen: one oddity at a time gets past the first check.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rarely<T>(pub(crate) Option<T>);

impl<T> Default for Rarely<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<'a, T: Arbitrary<'a>> Arbitrary<'a> for Rarely<T> {
    fn arbitrary(bytes: &mut Unstructured<'a>) -> Result<Self> {
        Ok(Self(if bytes.arbitrary::<u8>()? >= 240 { Some(bytes.arbitrary()?) } else { None }))
    }
}

impl<T: Copy> Rarely<T> {
    pub(crate) fn or(self, usual: T) -> T {
        self.0.unwrap_or(usual)
    }
}

/// A number: mostly a plain one, seldom any bits at all.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Number(pub(crate) f32);

impl<'a> Arbitrary<'a> for Number {
    fn arbitrary(bytes: &mut Unstructured<'a>) -> Result<Self> {
        let kind: u8 = bytes.arbitrary()?;
        Ok(Self(match kind {
            0..=223 => f32::from(bytes.arbitrary::<i16>()?) / 64.,
            224..=239 => f32::from(bytes.arbitrary::<i16>()?) * 4096.,
            _ => bytes.arbitrary()?,
        }))
    }
}

/// Splits an input into its first byte and the rest.
pub(crate) fn kind(input: &[u8]) -> (u8, &[u8]) {
    input.split_first().map_or((0, input), |(first, rest)| (*first, rest))
}

/// Frames of [`road`]: a window of [`windows`] and one more.
const FRAMES: u32 = 14;

/// How [`road`] is cut: 3 observed and 10 predicted frames.
pub(crate) fn windows() -> WindowConfig {
    let site_stride_s = BTreeMap::new();
    WindowConfig { observed_s: 0.2, predicted_s: 1., rate_hz: 10., stride_s: 0.1, site_stride_s }
}

/// A recording of three vehicles for [`FRAMES`] at 10 Hz on two lanes, the first two one behind the other.
pub(crate) fn road(name: &str) -> Result<Recording, Finding> {
    let vehicles = [(1, 0., 1.8, 2), (2, 30., 1.7, 2), (5, 10., 5.4, 1)];
    let all = || vehicles.iter().flat_map(|it| (0..FRAMES).map(move |frame| (*it, frame)));
    let (vehicle, frame): (Vec<u32>, Vec<u32>) = all().map(|((id, ..), frame)| (id, frame)).unzip();
    let x = all().map(|((id, x, ..), frame)| x + (2. + 0.1 * id as f32) * frame as f32).collect();
    let y = all().map(|((_, _, y, _), _)| y).collect();
    let lane = all().map(|((.., lane), _)| lane).collect();
    let mut rows = Rows::new(vehicle, frame, x, y);
    rows.lane = lane;
    rows.neighbours = NeighbourSource::Lanes(|lane| lane);
    let lines = [0., 3.6, 7.2].map(|y| LaneMarking::new(y, y != 3.6)).to_vec();
    let roads = vec![Road { driving_direction: 2, lines, fitted: false, axis: None }];
    let meta = RecordingMeta::new(Dataset::NGSIM, "us-101", name, 10.);
    let body = |_| VehicleBody { class: VehicleClass::Car, length: 4.5, width: 1.8, road: 0 };
    Recording::from_rows(meta, roads, rows, body).map(|(recording, _)| recording).map_err(Finding::case)
}
