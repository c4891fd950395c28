//! What moved a vehicle, cause by cause: forces summed up to displacements.

use gnp_baselines::{ActingTerms, PlatoonRule, Traffic};
use gnp_data::{Cause, Contribution, Forecast, Slot, TermForces};
use gnp_traj::{Arity, Integrator};

use crate::error::ModelError;
use crate::situation::Situation;

/// Adds to every path of `forecast` the contributions that lead from constant velocity to it, and to its forces those of
/// the platoon's path.
///
/// The reference path comes apart by taking the column away from its near end on: what leader 1 contributes is how far
/// the path changes when he is gone and the next is followed, what leader 2 contributes the change when he is gone as
/// well, and what is left without anybody ahead is the free road's. The rest of the path is a sum of forces, so that each
/// term's share is its own sum. What a switched-off term would cause is not there; where none acts the free road stands
/// alone, with 0.
pub(crate) fn add(
    situation: &Situation<'_>,
    (platoon, acting): (Option<&PlatoonRule>, ActingTerms),
    integrator: Integrator,
    forecast: &mut Forecast,
) -> Result<(), ModelError> {
    let shape = situation.view().observation().shape();
    let reference = of_reference(situation, platoon, acting)?;
    let forces = of_platoon(situation, acting);
    for explanation in forecast.modes.iter_mut().filter_map(|mode| mode.explanation.as_mut()) {
        explanation.velocity = situation.velocity();
        explanation.contributions = reference.clone();
        for term in &explanation.terms {
            let moved = |source: Option<usize>| {
                let force = |step| match source {
                    None => term.total(step),
                    Some(source) => term.forces(step).get(source).copied().unwrap_or_default(),
                };
                displacement(force, shape.t_pred, shape.dt(), integrator)
            };
            let mut push = |cause, displacement| explanation.contributions.push(Contribution { cause, displacement });
            match (&*term.term().name, term.term().arity) {
                ("goal", _) => push(Cause::Intention, moved(None)),
                ("neighbours", Arity::PerNeighbour) => {
                    for slot in Slot::ALL {
                        if let Some(neighbour) = situation.view().neighbour(slot) {
                            push(Cause::Neighbour { vehicle: neighbour.vehicle() }, moved(Some(slot.index())));
                        }
                    }
                }
                (name, _) => push(Cause::Term(name.to_owned()), moved(None)),
            }
        }
        if explanation.contributions.is_empty() {
            // Nothing acts: constant velocity is the path, and is said to be.
            let displacement = vec![[0.; 2]; shape.t_pred];
            explanation.contributions.push(Contribution { cause: Cause::FreeRoad, displacement });
        }
        explanation.terms.extend(forces.iter().cloned());
    }
    Ok(())
}

/// The platoon's path less constant velocity, by leader; nothing where the reference path is constant velocity.
fn of_reference(
    situation: &Situation<'_>,
    platoon: Option<&PlatoonRule>,
    acting: ActingTerms,
) -> Result<Vec<Contribution>, ModelError> {
    let (Some(platoon), Some(following)) = (platoon, &situation.platoon) else { return Ok(Vec::new()) };
    let observation = situation.view().observation();
    let shape = observation.shape();
    let path = |removed: usize| -> Result<Vec<f64>, ModelError> {
        let motion =
            platoon.roll_out_with(observation.site(), &following.traffic.without_nearest(removed), &shape, acting)?;
        Ok((1..=shape.t_pred).map(|step| motion.position(Traffic::TARGET, step)).collect())
    };
    let difference = |cause, with: &[f64], without: &[f64]| Contribution {
        cause,
        displacement: with.iter().zip(without).map(|(with, without)| [(with - without) as f32, 0.]).collect(),
    };
    let mut with = path(0)?;
    let mut parts = Vec::new();
    let [_, follows, habit] = acting.flags();
    for (gone, leader) in following.traffic.column().enumerate().filter(|_| follows) {
        let without = path(gone + 1)?;
        parts.push(difference(Cause::Leader { vehicle: leader.vehicle, place: gone + 1 }, &with, &without));
        with = without;
    }
    let speed = f64::from(situation.velocity()[0]);
    let straight: Vec<f64> = (1..=shape.t_pred).map(|step| speed * step as f64 * shape.dt()).collect();
    // Alone, a driver without a habit keeps his speed.
    if habit {
        parts.insert(0, difference(Cause::FreeRoad, &with, &straight));
    }
    Ok(parts)
}

/// The forces that act along the platoon's path.
fn of_platoon(situation: &Situation<'_>, acting: ActingTerms) -> Vec<TermForces> {
    let Some(following) = &situation.platoon else { return Vec::new() };
    let steps = situation.view().observation().shape().t_pred;
    PlatoonRule::terms()
        .into_iter()
        .enumerate()
        .zip(acting.flags())
        .filter(|(_, acts)| *acts)
        .map(|((part, term), _)| {
            let forces = (0..steps).map(|step| [following.motion.acceleration(step)[part] as f32, 0.]).collect();
            TermForces::new(term, 1, forces, Vec::new())
        })
        .collect()
}

/// How far a force (m/s², by step) alone has moved a vehicle after each of `steps` steps of `dt` s, m, as the roll-out sums it up.
fn displacement(force: impl Fn(usize) -> [f32; 2], steps: usize, dt: f64, integrator: Integrator) -> Vec<[f32; 2]> {
    let (mut position, mut velocity) = ([0f64; 2], [0f64; 2]);
    (0..steps)
        .map(|step| {
            let before = velocity;
            let force = force(step);
            for axis in 0..2 {
                velocity[axis] += f64::from(force[axis]) * dt;
                let carried = if integrator == Integrator::ExplicitEuler { before } else { velocity };
                position[axis] += carried[axis] * dt;
            }
            position.map(|value| value as f32)
        })
        .collect()
}
