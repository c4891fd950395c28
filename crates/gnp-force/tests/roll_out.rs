//! Roll-outs backwards: against finite differences, with few copies, with vehicles that come, go and are steered.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
mod differences;

use differences::{Vehicles, compare, numbers, scene};
use gnp_force::{
    DifferentiableRule, Drive, Ego, EgoGradient, ForceError, Headways, Idm, Inflow, MotorwayRule, Newell, Other,
    PairRule, PushGradient, Reach, Road, RollOut, Rule, SceneGradient, Simulator, SimulatorParams, State, Vehicle,
    VehicleGradient, VehicleId,
    na::{RealField, Vector2, convert},
};
use std::sync::{
    Arc,
    atomic::{AtomicUsize, Ordering::Relaxed},
};

type Scene = Simulator<f64>;

const STEPS: usize = 100;

fn params() -> SimulatorParams<f64> {
    SimulatorParams::motorway(0.1)
}

fn road() -> Road<f64> {
    Road::motorway(2, 3.75).unwrap()
}

fn idm() -> Idm<f64> {
    Idm { time_gap: 1.1, standstill_gap: 2.0, acceleration: 1.4, braking: 2.0 }
}

/// Two lanes; in each a leader and two who close in on him, with three kinds of rules.
fn six() -> Vehicles {
    let rules: [Rule<f64>; 3] = [idm().into(), MotorwayRule::standard().into(), Newell::standard().into()];
    (0..6)
        .map(|i| {
            let (lane, rank) = (i % 2, i / 2);
            let y = 1.875 + 3.75 * lane as f64;
            let state = State::new(-42.0 * rank as f64 - 11.0 * lane as f64, y, 22.0 + 1.5 * rank as f64, 0.0);
            let speed = 20.0 + 4.0 * rank as f64 + 2.0 * lane as f64;
            let aim = y + if lane == 0 { 0.2 } else { -0.3 };
            Vehicle::car(state, Drive::Cruise { speed, y: aim }).with_rule(rules[(i + i / 3) % 3])
        })
        .collect()
}

/// How far all are from uneven places, every second step: a number, and what it is in the gradient.
fn loss(step: usize, scene: &Scene) -> f64 {
    if step % 2 == 1 {
        return 0.0;
    }
    scene.vehicles().map(|(id, vehicle)| term(id, vehicle)).sum()
}

fn term(id: VehicleId, vehicle: &Vehicle<f64>) -> f64 {
    let (p, v) = (vehicle.state.position, vehicle.state.velocity);
    1e-4 * (p.x - 90.0).powi(2) + (p.y - 3.0).powi(2) + (0.3 + 0.01 * id.0 as f64) * v.x
}

fn add_loss(step: usize, scene: &Scene, gradient: &mut SceneGradient<f64>) -> Result<(), ForceError> {
    for (id, vehicle) in scene.vehicles().filter(|_| step.is_multiple_of(2)) {
        let own = &mut gradient.of(id)?.state;
        let p = vehicle.state.position;
        own.position += Vector2::new(2e-4 * (p.x - 90.0), 2.0 * (p.y - 3.0));
        own.velocity.x += 0.3 + 0.01 * id.0 as f64;
    }
    Ok(())
}

fn rolled(mut scene: Scene, mut control: impl FnMut(usize, &mut Scene) -> Result<(), ForceError>) -> f64 {
    let mut sum = loss(0, &scene);
    for step in 0..STEPS {
        control(step, &mut scene).unwrap();
        scene.step();
        sum += loss(step + 1, &scene);
    }
    sum
}

#[test]
fn gradients_of_a_hundred_steps_are_those_of_differences() {
    let vehicles = six();
    let mut last = scene(params(), &road(), &vehicles);
    let roll_out = RollOut::record(&mut last, STEPS);
    let mut again = scene(params(), &road(), &vehicles);
    (0..STEPS).for_each(|_| drop(again.step().to_vec()));
    assert!(last.vehicles().eq(again.vehicles()), "recorded, the scene moves as it does");
    let gradient = roll_out.vjp(add_loss).unwrap();
    let value = |vehicles: &[Vehicle<f64>]| rolled(scene(params(), &road(), vehicles), |_, _| Ok(()));
    let compared = compare(&vehicles, &gradient.scene, value, (1e-4, 1e-6));
    assert!(compared.numbers == 6 * 7 + 2 * (4 + 8 + 2) && compared.nonzero > 55, "{compared:?}");
    assert!(gradient.given.is_empty());
}

#[test]
fn every_number_of_copies_gives_the_same_bits() {
    let vehicles = six();
    let gradient = |between: usize| {
        let mut scene = scene(params(), &road(), &vehicles);
        let roll_out = RollOut::spaced(&mut scene, STEPS, between, |_, _| Ok(())).unwrap();
        assert_eq!(roll_out.copies(), STEPS.div_ceil(between.max(1)));
        let gradient = roll_out.vjp(add_loss).unwrap();
        let bits = |of: &VehicleGradient<f64>| numbers(of).into_iter().map(f64::to_bits).collect::<Vec<_>>();
        gradient.scene.iter().map(|(_, of)| bits(of)).collect::<Vec<_>>()
    };
    let every = gradient(1);
    for between in [0, 2, 7, 10, 33, 99, 100, 1000] {
        assert_eq!(gradient(between), every, "a copy every {between} steps");
    }
}

/// A rule that counts how many of it there are, and how often it is asked.
#[derive(Debug)]
struct Counted {
    rule: Idm<f64>,
    counts: Arc<Counts>,
}

#[derive(Debug, Default)]
struct Counts {
    alive: AtomicUsize,
    most: AtomicUsize,
    asked: AtomicUsize,
}

impl Counted {
    fn new(rule: Idm<f64>, counts: &Arc<Counts>) -> Self {
        let alive = counts.alive.fetch_add(1, Relaxed) + 1;
        counts.most.fetch_max(alive, Relaxed);
        Self { rule, counts: counts.clone() }
    }
}

impl Clone for Counted {
    fn clone(&self) -> Self {
        Self::new(self.rule, &self.counts)
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.counts.alive.fetch_sub(1, Relaxed);
    }
}

impl PairRule<f64> for Counted {
    fn reach(&self) -> Reach {
        PairRule::<f64>::reach(&self.rule)
    }

    fn free(&self, me: &Ego<f64>) -> f64 {
        self.rule.free(me)
    }

    fn push(&self, me: &Ego<f64>, other: &Other<f64>) -> Vector2<f64> {
        self.counts.asked.fetch_add(1, Relaxed);
        self.rule.push(me, other)
    }
}

impl DifferentiableRule<f64> for Counted {
    fn names(&self) -> &'static [&'static str] {
        DifferentiableRule::<f64>::names(&self.rule)
    }

    fn parameters(&self) -> Vec<f64> {
        self.rule.parameters()
    }

    fn with_parameters(&self, parameters: &[f64]) -> Result<Self, ForceError> {
        self.rule.with_parameters(parameters).map(|rule| Self::new(rule, &self.counts))
    }

    fn free_vjp(&self, me: &Ego<f64>, cotangent: f64, d: &mut [f64]) -> EgoGradient<f64> {
        self.rule.free_vjp(me, cotangent, d)
    }

    fn push_vjp(&self, me: &Ego<f64>, other: &Other<f64>, cotangent: Vector2<f64>, d: &mut [f64]) -> PushGradient<f64> {
        self.rule.push_vjp(me, other, cotangent, d)
    }
}

#[test]
fn memory_grows_with_the_root_of_the_steps_and_no_step_is_taken_more_than_twice() {
    for steps in [100, 400, 1600] {
        let counts = Arc::new(Counts::default());
        let mut scene = Simulator::for_rules(params(), Road::open()).unwrap();
        for x in [0.0, -30.0] {
            let car = Vehicle::car(State::new(x, 0.0, 20.0, 0.0), Drive::Cruise { speed: 24.0, y: 0.0 });
            scene.add(car.with_rule(Counted::new(idm(), &counts))).unwrap();
        }
        let roll_out = RollOut::record(&mut scene, steps);
        let forward = counts.asked.swap(0, Relaxed);
        assert_eq!((forward, roll_out.copies()), (steps, steps.isqrt()), "one follows the other");
        roll_out.vjp(|_, _, gradient| gradient.of(VehicleId(1)).map(|own| own.state.position.x += 1.0)).unwrap();
        // Going back, a step is computed once more, and its accelerations once again for their gradient.
        assert_eq!(counts.asked.load(Relaxed), 2 * forward);
        let scenes = counts.most.load(Relaxed).div_ceil(2);
        assert!(scenes <= 2 * steps.isqrt() + 4, "{scenes} scenes at a time for {steps} steps");
    }
}

#[test]
fn vehicles_that_enter_on_the_way_have_a_gradient_in_how_they_entered() {
    let road = Road::motorway(1, 3.75).unwrap().ending_at(150.0).unwrap();
    let car = |x: f64, v: f64, rule: Idm<f64>| {
        Vehicle::car(State::new(x, 1.875, v, 0.0), Drive::Cruise { speed: 24.0, y: 1.875 }).with_rule(Rule::Idm(rule))
    };
    let control = |time_gap: f64, x: f64| {
        let mut inflow = Inflow::new(1100.0, Headways::Random, 4).unwrap();
        move |_: usize, scene: &mut Scene| {
            scene.admit(&mut inflow, |_| car(x, 18.0, Idm { time_gap, ..idm() })).map(drop)
        }
    };
    let first = vec![car(60.0, 20.0, idm())];
    let mut last = scene(params(), &road, &first);
    let roll_out = RollOut::controlled(&mut last, STEPS, control(1.1, 0.0)).unwrap();
    let entered = last.vehicles().filter(|(id, _)| id.0 > 0).count();
    assert!(entered >= 2 && last.vehicle(VehicleId(0)).is_none(), "{entered} came, and the first one left");
    let gradient = roll_out.vjp(add_loss).unwrap();
    let value = |time_gap: f64, x: f64| rolled(scene(params(), &road, &first), control(time_gap, x));
    let newcomers = || gradient.scene.iter().filter(|(id, _)| id.0 > 0).map(|(_, of)| of);
    assert!(newcomers().count() > entered, "one of them left, too");
    for (found, up, down) in [
        (newcomers().map(|of| of.rule[0]).sum::<f64>(), value(1.1 + 1e-4, 0.0), value(1.1 - 1e-4, 0.0)),
        (newcomers().map(|of| of.state.position.x).sum(), value(1.1, 1e-4), value(1.1, -1e-4)),
    ] {
        let expected = (up - down) / 2e-4;
        assert!((found - expected).abs() < 1e-6 * expected.abs().max(1.0) && expected != 0.0, "{found} {expected}");
    }
    let value = |vehicles: &[Vehicle<f64>]| rolled(scene(params(), &road, vehicles), control(1.1, 0.0));
    compare(&first, &gradient.scene, value, (1e-4, 1e-6));
}

#[test]
fn what_is_given_on_the_way_has_a_gradient_and_hides_what_was_before() {
    // A leader is put where he was recorded, his follower gets another wish, then another rule, the third is taken away.
    let mut vehicles: Vehicles = six().into_iter().step_by(2).collect();
    vehicles[1].rule = idm().into();
    let newell = Newell::standard();
    let control = |by: [f64; 4]| {
        move |step: usize, scene: &mut Scene| {
            let time = 0.1 * step as f64;
            if step > 0 {
                let x = 21.0 * time + time.sin() + if step == 30 { by[0] } else { 0.0 };
                scene.set_state(VehicleId(0), State::new(x, 1.875, 21.0 + time.cos(), 0.0))?;
            }
            if step == 20 {
                scene.set_drive(VehicleId(1), Drive::Cruise { speed: 19.0 + by[1], y: 1.5 + by[2] })?;
            }
            if step == 50 {
                let wave_time = newell.wave_time + by[3];
                scene.set_rule(VehicleId(1), Rule::Newell(Newell { wave_time, ..newell }))?;
            }
            if step == 70 {
                scene.remove(VehicleId(2))?;
            }
            Ok(())
        }
    };
    let mut last = scene(params(), &road(), &vehicles);
    let roll_out = RollOut::controlled(&mut last, STEPS, control([0.0; 4])).unwrap();
    let gradient = roll_out.vjp(add_loss).unwrap();
    let given = |step: usize, id: u64| {
        let mut all = gradient.given.iter().filter(|given| (given.step, given.id) == (step, VehicleId(id)));
        all.next().map(|given| numbers(&given.gradient)).unwrap()
    };
    let found = [given(30, 0)[0], given(20, 1)[4], given(20, 1)[5], given(50, 1)[7]];
    for (i, found) in found.into_iter().enumerate() {
        let at = |by: f64| {
            let mut all = [0.0; 4];
            all[i] = by;
            rolled(scene(params(), &road(), &vehicles), control(all))
        };
        let expected = (at(1e-4) - at(-1e-4)) / 2e-4;
        assert!((found - expected).abs() < 1e-6 * expected.abs().max(1.0) && expected != 0.0, "{i} {found} {expected}");
    }
    let value = |vehicles: &[Vehicle<f64>]| rolled(scene(params(), &road(), vehicles), control([0.0; 4]));
    compare(&vehicles, &gradient.scene, value, (1e-4, 1e-6));
    assert_eq!(gradient.given.len(), 99 + 2);
    assert!(gradient.given.windows(2).all(|pair| pair[0].step >= pair[1].step), "the latest first");
}

/// How the place of a follower after ten seconds depends on his time gap and on how fast he was.
fn of_a_follower<T: RealField + Copy>() -> [f64; 2] {
    let lit = convert::<f64, T>;
    let mut scene = Simulator::for_rules(SimulatorParams::motorway(lit(0.1)), Road::open()).unwrap();
    for (x, v) in [(0.0, 20.0), (-30.0, 25.0)] {
        let cruise = Drive::Cruise { speed: lit(v), y: T::zero() };
        let car = Vehicle::car(State::new(lit(x), T::zero(), lit(v), T::zero()), cruise);
        scene.add(car.with_rule(MotorwayRule::standard())).unwrap();
    }
    let roll_out = RollOut::record(&mut scene, STEPS);
    let last = |step: usize| if step == STEPS { T::one() } else { T::zero() };
    let gradient = roll_out
        .vjp(|step, _, gradient| gradient.of(VehicleId(1)).map(|own| own.state.position.x += last(step)))
        .unwrap();
    let own = gradient.scene.get(VehicleId(1)).unwrap();
    [own.rule[1], own.state.velocity.x].map(|value| value.to_subset().unwrap())
}

#[test]
fn single_precision_gives_the_same_gradient_to_single_precision() {
    let (double, single) = (of_a_follower::<f64>(), of_a_follower::<f32>());
    for (double, single) in double.into_iter().zip(single) {
        assert!((double - single).abs() < 1e-3 * double.abs() && double.abs() > 0.1, "{double} {single}");
    }
}

#[test]
fn errors_of_a_program_come_through_and_no_steps_are_a_roll_out_too() {
    let vehicles = six();
    let mut last = scene(params(), &road(), &vehicles);
    let stop = |step: usize, scene: &mut Scene| {
        if step == 3 { scene.remove(VehicleId(99)).map(drop) } else { Ok(()) }
    };
    let refused = RollOut::controlled(&mut last, STEPS, stop).unwrap_err();
    assert_eq!(refused, ForceError::UnknownVehicle { id: VehicleId(99) });
    assert_eq!(last.time(), 3.0 * 0.1);

    let mut still = scene(params(), &road(), &vehicles);
    let roll_out = RollOut::record(&mut still, 0);
    let gradient = roll_out.vjp(add_loss).unwrap();
    let own = gradient.scene.get(VehicleId(3)).unwrap();
    assert!((own.state.velocity.x - 0.33).abs() < 1e-15);
    assert!(roll_out.vjp(|_, _, gradient| gradient.of(VehicleId(6)).map(drop)).is_err());
}
