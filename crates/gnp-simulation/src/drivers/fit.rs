//! The five numbers of the intelligent driver model for every recorded follower.
use super::{
    FittedDriver,
    error::{DriverError, require},
    free::{FreeSpeed, free_speeds},
    median,
    noise::unsteadiness,
    stretches::{Errors, Stretch, stretches},
};
use argmin::core::{CostFunction, Error, Executor, State};
use argmin::solver::neldermead::NelderMead;
use gnp_data::{Recording, VehicleClass};
use gnp_force::{Driver, Extent, Noise};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Steps of a search; it ends sooner where it finds nothing better.
const STEPS: u64 = 300;
/// Spread of the cost among the corners of the search at which it ends.
const TOLERANCE: f64 = 1e-4;
/// Passes over all drivers: each takes its prior from the one before.
const PASSES: usize = 3;
/// Relative error of the gap that the first pass expects, and the least that a later one does.
const EXPECTED_ERROR: [f64; 2] = [0.15, 0.01];
/// Time over which errors of the gap are one error, s.
const ERROR_S: f64 = 4.;
/// Vehicles of a class from which it has typical values of its own.
const LEAST_OF_CLASS: usize = 10;
/// Desired speeds where too few drive freely, m/s: 120 km/h, of trucks 85 km/h.
const DESIRED_SPEEDS: [f64; 2] = [120. / 3.6, 85. / 3.6];

/// A number that is fitted: where it stands, the range that drivers of motorways have, and the standard deviation of its
/// logarithm among drivers as the prior has it.
struct Parameter {
    of: fn(&mut Driver<f64>) -> &mut f64,
    range: [f64; 2],
    spread: f64,
}

/// In the order of [`Driver`].
const FITTED: [Parameter; 5] = [
    Parameter { of: |d| &mut d.desired_speed, range: [8., 60.], spread: 0.15 },
    Parameter { of: |d| &mut d.time_gap, range: [0.2, 4.], spread: 0.5 },
    Parameter { of: |d| &mut d.standstill_gap, range: [0.5, 8.], spread: 0.4 },
    Parameter { of: |d| &mut d.acceleration, range: [0.2, 4.], spread: 0.5 },
    Parameter { of: |d| &mut d.braking, range: [0.3, 6.], spread: 0.5 },
];

impl Parameter {
    fn get(&self, driver: &Driver<f64>) -> f64 {
        *(self.of)(&mut { *driver })
    }
}

/// What is fitted, and to whom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitConfig {
    /// Least time that a driver is recorded behind leaders, s.
    pub least_s: f64,
    /// Whether a number is the same vehicle in every recording, as in scenes that were cut from one. It is then fitted
    /// where it is seen for longest.
    pub shared_vehicles: bool,
}

impl Default for FitConfig {
    /// 6 s; every recording has vehicles of its own.
    fn default() -> Self {
        Self { least_s: 6., shared_vehicles: false }
    }
}

/// A vehicle of one of several recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DriverKey {
    /// Place of the recording among those given.
    pub recording: usize,
    /// Number in it.
    pub vehicle: u32,
}

/// Vehicles that were not fitted, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Never behind anybody for 3 s, at a gap of half a metre or more.
    pub without_leader: usize,
    /// Behind somebody, but for less than was asked for.
    pub too_short: usize,
    /// Seen for longer in another recording.
    pub repeated: usize,
}

/// Root mean square error of the gap over all frames of following, m, of three kinds of drivers behind the recorded
/// leaders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowingErrors {
    /// [`Driver::motorway`] for everybody.
    pub standard_m: f64,
    /// The typical driver of the vehicle's class.
    pub typical_m: f64,
    /// His own fit.
    pub own_m: f64,
}

/// The drivers of recordings of one site.
#[derive(Clone, Debug)]
pub struct FittedTraffic {
    pub(super) config: FitConfig,
    pub(super) simulated: bool,
    pub(super) recordings: usize,
    drivers: BTreeMap<DriverKey, FittedDriver>,
    typical: Typical,
    left_out: LeftOut,
    errors: FollowingErrors,
    free: Vec<FreeSpeed>,
    noise: Option<Noise<f64>>,
}

impl FittedTraffic {
    /// The drivers, by recording and vehicle.
    #[must_use]
    pub fn drivers(&self) -> &BTreeMap<DriverKey, FittedDriver> {
        &self.drivers
    }

    /// The medians of a class; those of all vehicles for a class with fewer than 10.
    #[must_use]
    pub fn typical(&self, class: VehicleClass) -> Driver<f64> {
        self.typical.of(class)
    }

    /// Who was not fitted.
    #[must_use]
    pub fn left_out(&self) -> LeftOut {
        self.left_out
    }

    /// How well the drivers follow, in the sample that they were fitted to.
    #[must_use]
    pub fn errors(&self) -> FollowingErrors {
        self.errors
    }

    /// Those who drive freely: see [`FreeSpeed`].
    #[must_use]
    pub fn free(&self) -> &[FreeSpeed] {
        &self.free
    }

    /// What their model does not explain, as a process; none where too little is recorded.
    #[must_use]
    pub fn noise(&self) -> Option<Noise<f64>> {
        self.noise
    }

    /// How somebody drives: his own fit, or the typical driver of his class.
    pub(super) fn driver(&self, key: DriverKey, class: VehicleClass) -> Driver<f64> {
        self.drivers.get(&key).map_or_else(|| self.typical(class), |fitted| fitted.driver)
    }
}

/// A vehicle with its stretches of following.
struct Followed {
    key: DriverKey,
    class: VehicleClass,
    extent: Extent<f64>,
    stretches: Vec<Stretch>,
}

impl Followed {
    fn seconds(&self) -> f64 {
        self.stretches.iter().map(Stretch::seconds).sum()
    }

    fn errors(&self, driver: &Driver<f64>) -> Errors {
        self.stretches.iter().fold(Errors::default(), |sum, stretch| sum.add(stretch.errors(driver)))
    }
}

/// Fits every driver who is recorded behind a leader for long enough.
///
/// A driver is rolled out behind the recorded leader, from the first frame of each stretch on, and the mixed error measure
/// of the gap is least (Treiber and Kesting 2013, section 16.3): absolute errors count more where the gap is large,
/// relative ones where it is small. Beside it stands a prior, a normal distribution of the logarithms around the medians
/// of the vehicle's class, weighted as if errors 4 s apart were independent and as large as those of the median driver:
/// of what a short track does not tell, the typical value remains. Desired speeds begin at those of the freely driving,
/// of which there are at least 10 of the class, else at 120 km/h, of trucks 85 km/h; congested traffic does not tell them.
///
/// The same recordings give the same drivers on any number of threads.
///
/// # Errors
/// [`DriverError::NoFollowers`]; [`DriverError::Value`] for a `least_s` that is not positive; [`DriverError::Search`].
pub fn fit_drivers(recordings: &[Recording], config: &FitConfig) -> Result<FittedTraffic, DriverError> {
    require(config.least_s > 0. && config.least_s.is_finite(), "least_s", config.least_s, "positive and finite")?;
    let (followed, left_out) = followed(recordings, config);
    if followed.is_empty() {
        let vehicles = left_out.without_leader + left_out.too_short;
        return Err(DriverError::NoFollowers { vehicles, least_s: config.least_s });
    }
    let free: Vec<FreeSpeed> = recordings.par_iter().flat_map_iter(free_speeds).collect();
    let mut typical = Typical::standard(&free);
    let mut expected = EXPECTED_ERROR[0];
    let mut found: Vec<Driver<f64>> = Vec::new();
    for _ in 0..PASSES {
        let search = |followed: &Followed| Problem { followed, centre: typical.of(followed.class), expected }.fit();
        found = followed.par_iter().map(search).collect::<Result<_, Error>>().map_err(failed)?;
        typical = Typical::of_drivers(followed.iter().map(|it| it.class).zip(found.iter().copied()), &typical);
        let errors = followed.par_iter().zip(&found).map(|(it, driver)| it.errors(driver).mixed_square().sqrt());
        expected = median(errors.collect()).max(EXPECTED_ERROR[1]);
    }
    let total = |driver: &(dyn Fn(usize) -> Driver<f64> + Sync)| {
        let errors: Vec<Errors> = followed.par_iter().enumerate().map(|(i, it)| it.errors(&driver(i))).collect();
        errors.into_iter().fold(Errors::default(), Errors::add).metres()
    };
    let errors = FollowingErrors {
        standard_m: total(&|_| Driver::motorway()),
        typical_m: total(&|i| typical.of(followed[i].class)),
        own_m: total(&|i| found[i]),
    };
    let each = followed.iter().zip(&found);
    let rolled: Vec<_> = each.flat_map(|(it, driver)| it.stretches.iter().map(move |of| (of, *driver))).collect();
    let noise = unsteadiness(&rolled);
    let driver = |(it, driver): (&Followed, &Driver<f64>)| {
        let errors = it.errors(driver);
        let (error_m, error) = (errors.metres(), errors.mixed_square().sqrt());
        let (class, extent, seconds) = (it.class, it.extent, it.seconds());
        (it.key, FittedDriver { class, extent, driver: *driver, error_m, error, seconds })
    };
    Ok(FittedTraffic {
        config: *config,
        simulated: recordings.iter().any(|recording| recording.meta().simulated),
        recordings: recordings.len(),
        drivers: followed.iter().zip(&found).map(driver).collect(),
        typical,
        left_out,
        errors,
        free,
        noise,
    })
}

fn failed(error: Error) -> DriverError {
    DriverError::Search(error.to_string())
}

/// Who follows for long enough, in the order of keys, and who does not.
fn followed(recordings: &[Recording], config: &FitConfig) -> (Vec<Followed>, LeftOut) {
    let of_recording = |(number, recording): (usize, &Recording)| {
        let mut vehicles: BTreeMap<DriverKey, Followed> = BTreeMap::new();
        for track in recording.tracks() {
            let key = DriverKey { recording: number, vehicle: track.vehicle };
            let extent = Extent { length: f64::from(track.length), width: f64::from(track.width) };
            let new = || Followed { key, class: track.class, extent, stretches: Vec::new() };
            vehicles.entry(key).or_insert_with(new).stretches.extend(stretches(recording, track));
        }
        vehicles.into_values().collect::<Vec<_>>()
    };
    let mut all: Vec<Followed> = recordings.par_iter().enumerate().flat_map_iter(of_recording).collect();
    let mut left_out = LeftOut::default();
    if config.shared_vehicles {
        let mut longest: BTreeMap<u32, (f64, DriverKey)> = BTreeMap::new();
        for it in &all {
            let best = longest.entry(it.key.vehicle).or_insert((it.seconds(), it.key));
            if it.seconds() > best.0 {
                *best = (it.seconds(), it.key);
            }
        }
        let before = all.len();
        all.retain(|it| longest.get(&it.key.vehicle).is_some_and(|(_, key)| *key == it.key));
        left_out.repeated = before - all.len();
    }
    all.retain(|it| {
        let seconds = it.seconds();
        left_out.without_leader += usize::from(seconds == 0.);
        left_out.too_short += usize::from(seconds > 0. && seconds < config.least_s);
        seconds >= config.least_s
    });
    (all, left_out)
}

/// Typical drivers, by class.
#[derive(Clone, Debug)]
struct Typical {
    all: Driver<f64>,
    classes: BTreeMap<VehicleClass, Driver<f64>>,
}

const CLASSES: [VehicleClass; 3] = [VehicleClass::Motorcycle, VehicleClass::Car, VehicleClass::Truck];

impl Typical {
    /// [`Driver::motorway`] at the speeds of the freely driving.
    fn standard(free: &[FreeSpeed]) -> Self {
        let of_class = |class: VehicleClass| {
            let speeds: Vec<f64> = free.iter().filter(|it| it.class == class).map(|it| it.speed).collect();
            let [car, truck] = DESIRED_SPEEDS;
            let standard = if class == VehicleClass::Truck { truck } else { car };
            let desired_speed = if speeds.len() < LEAST_OF_CLASS { standard } else { median(speeds) };
            (class, Driver { desired_speed, ..Driver::motorway() })
        };
        Self { all: Driver::motorway(), classes: CLASSES.map(of_class).into() }
    }

    /// The medians of drivers. The desired speed of a class with too few is that of `before`.
    fn of_drivers(drivers: impl Iterator<Item = (VehicleClass, Driver<f64>)>, before: &Self) -> Self {
        let drivers: Vec<_> = drivers.collect();
        let medians = |of: &[&Driver<f64>]| {
            let mut driver = Driver::motorway();
            for parameter in &FITTED {
                *(parameter.of)(&mut driver) = median(of.iter().map(|driver| parameter.get(driver)).collect());
            }
            driver
        };
        let all = medians(&drivers.iter().map(|(_, driver)| driver).collect::<Vec<_>>());
        let of_class = |class: VehicleClass| {
            let of: Vec<_> = drivers.iter().filter(|it| it.0 == class).map(|(_, driver)| driver).collect();
            let few = || Driver { desired_speed: before.of(class).desired_speed, ..all };
            (class, if of.len() < LEAST_OF_CLASS { few() } else { medians(&of) })
        };
        Self { all, classes: CLASSES.map(of_class).into() }
    }

    fn of(&self, class: VehicleClass) -> Driver<f64> {
        self.classes.get(&class).copied().unwrap_or(self.all)
    }
}

/// One driver who is searched.
struct Problem<'a> {
    followed: &'a Followed,
    centre: Driver<f64>,
    expected: f64,
}

impl Problem<'_> {
    /// The driver at standard deviations from the typical one, each number in its range.
    fn driver(&self, at: &[f64]) -> Driver<f64> {
        let mut driver = self.centre;
        for (parameter, at) in FITTED.iter().zip(at) {
            let [low, high] = parameter.range;
            *(parameter.of)(&mut driver) =
                (parameter.get(&self.centre) * (at * parameter.spread).exp()).clamp(low, high);
        }
        driver
    }

    fn fit(&self) -> Result<Driver<f64>, Error> {
        let start = vec![0.; FITTED.len()];
        let mut corners = vec![start.clone()];
        corners.extend((0..start.len()).map(|i| {
            let mut corner = start.clone();
            corner[i] = 1.;
            corner
        }));
        let solver = NelderMead::new(corners).with_sd_tolerance(TOLERANCE)?;
        let found = Executor::new(self, solver).configure(|state| state.max_iters(STEPS)).run()?;
        Ok(self.driver(&found.state().get_best_param().cloned().unwrap_or(start)))
    }
}

impl CostFunction for &Problem<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    /// Twice the negative logarithm of the posterior density, but for a constant.
    fn cost(&self, at: &Vec<f64>) -> Result<f64, Error> {
        let errors = self.followed.errors(&self.driver(at)).mixed_square();
        let independent = (self.followed.seconds() / ERROR_S).max(1.);
        let departed: f64 = at.iter().map(|at| at * at).sum();
        Ok(errors / self.expected.powi(2) * independent + departed)
    }
}
