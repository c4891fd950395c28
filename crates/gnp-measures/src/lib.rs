//! What traffic engineers measure of a [`Recording`](gnp_data::Recording), real or simulated.
//!
//! [`Traffic`] looks at a recording once: lanes, positions along the road or around a ring, who follows whom. From it come
//! flow, density and speed over time and space ([`Cells`]) and at places ([`Station`]), the [`FundamentalDiagram`], waves
//! ([`Waves`]), surrogate measures of safety ([`Safety`]), lane changes ([`LaneChanges`]) and distributions
//! ([`Samples`]); [`Summary`] holds all of it.
//!
//! SI units: m, s, m/s. Two quantities are in the units that traffic engineers use, and say so: flow in vehicles an hour,
//! density in vehicles a kilometre. Time counts from the recording's first frame. A vehicle is where the centre of its box
//! is, unless front or rear is named.
//!
//! Only vehicles with rows are counted: flow and density of a file that has a sample of the vehicles are those of the sample.
//!
//! ```
//! use gnp_data::{Dataset, LaneMarking, Recording, RecordingMeta, Road, Rows, VehicleBody, VehicleClass};
//! use gnp_measures::{Course, Settings, Summary, Traffic};
//!
//! // Ten cars, one every 2 s, at 20 m/s.
//! let (cars, seconds) = (10, 60);
//! let (mut vehicle, mut frame, mut x) = (vec![], vec![], vec![]);
//! for car in 0..cars {
//!     for f in 0..10 * seconds {
//!         vehicle.push(car);
//!         frame.push(f);
//!         x.push(2. * f as f32 - 40. * car as f32);
//!     }
//! }
//! let mut rows = Rows::new(vehicle, frame, x.clone(), vec![0.; x.len()]);
//! rows.lane = vec![1; x.len()];
//! let road = Road { driving_direction: 2, lines: vec![], fitted: false, axis: None };
//! let meta = RecordingMeta::new(Dataset::LIVE, "nowhere", "ten cars", 10.);
//! let body = |_| VehicleBody { class: VehicleClass::Car, length: 5., width: 2., road: 0 };
//! let (recording, _) = Recording::from_rows(meta, vec![road], rows, body)?;
//!
//! let traffic = Traffic::new(&recording, Course::Open)?;
//! let summary = Summary::of(&traffic, &Settings::default())?;
//! assert!((summary.distributions.time_gap.as_ref().unwrap().quantile(0.5) - 1.75).abs() < 1e-3);
//! assert_eq!(summary.lane_changes.changes.len(), 0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bins;
mod cells;
mod contacts;
mod csv;
mod detectors;
mod diagram;
mod error;
mod following;
mod lane_changes;
mod robust;
mod safety;
mod samples;
mod settings;
mod summary;
mod traffic;
mod waves;

pub use crate::bins::Bins;
pub use crate::cells::{Cell, CellSize, Cells};
pub use crate::contacts::Contact;
pub use crate::csv::{cell_rows, detector_rows, event_rows};
pub use crate::detectors::{DetectorInterval, Passage, Station};
pub use crate::diagram::{Capacity, CongestedBranch, DiagramSettings, FlowPoint, FundamentalDiagram};
pub use crate::error::{MeasureError, Missing};
pub use crate::following::{Following, MIN_SPEED, Unpaired, drac, time_gap, ttc};
pub use crate::lane_changes::{Beside, Direction, LaneChange, LaneChangeSettings, LaneChanges, Situation};
pub use crate::safety::{Conflict, Exposure, Measure, Safety, SafetySettings};
pub use crate::samples::{Distance, Distribution, Distributions, Histogram, Sample, Samples};
pub use crate::settings::Settings;
pub use crate::summary::{LeftOut, Summary};
pub use crate::traffic::{Ahead, Course, Lane, Traffic};
pub use crate::waves::{PlaceWaves, WaveSettings, WaveSpeed, Waves};
