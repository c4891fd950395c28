//! Neighbours that react: every vehicle of a carriageway rolled out together.

use std::collections::BTreeMap;

use candle_core::{D, Tensor};
use gnp_data::{Neighbour, Observation, SLOTS, TrackState};
use gnp_traj::{NeighbourStates, RollOutBatch};

use crate::augmented_view::velocity_of;
use crate::error::ModelError;
use crate::gnp::{Gnp, end_points};
use crate::situation::Situation;

/// The vehicles of the carriageways that a batch of windows looks at, one row each.
struct Crowd<'a> {
    /// Vehicles with a whole observed past, by row.
    known: Vec<Observation<'a>>,
    /// Vehicles that appeared lately, on the rows after those: seen from the window that met them.
    late: Vec<Late<'a>>,
    /// Row of the vehicle in each slot of each known row.
    slots: Vec<[Option<usize>; SLOTS]>,
}

/// A vehicle without a whole observed past: it keeps its velocity.
struct Late<'a> {
    neighbour: Neighbour<'a>,
    /// Origin of the window that met it, m, road frame.
    origin: [f32; 2],
}

/// A vehicle at an instant: recording, track, frame.
type Place = (String, usize, u32);

impl<'a> Crowd<'a> {
    fn around(situations: &[Situation<'a>]) -> Self {
        let mut rows: BTreeMap<Place, usize> = BTreeMap::new();
        let mut known: Vec<Observation<'a>> = Vec::new();
        let place = |o: &Observation<'_>, track| (o.recording_name().to_owned(), track, o.frame());
        let mut met: Vec<Late<'a>> = Vec::new();
        let mut late: BTreeMap<Place, usize> = BTreeMap::new();
        for situation in situations {
            let target = *situation.view().observation();
            let others = target.others().collect::<Vec<_>>();
            let whole = others.iter().filter_map(Neighbour::observation);
            for observation in std::iter::once(target).chain(whole) {
                rows.entry(place(&observation, observation.track_index())).or_insert_with(|| {
                    known.push(observation);
                    known.len() - 1
                });
            }
            for neighbour in others.into_iter().filter(|other| other.observation().is_none()) {
                late.entry(place(&target, neighbour.track_index())).or_insert_with(|| {
                    met.push(Late { neighbour, origin: target.origin() });
                    met.len() - 1
                });
            }
        }
        let row = |o: &Observation<'_>, track: usize| {
            let key = place(o, track);
            rows.get(&key).copied().or_else(|| late.get(&key).map(|i| known.len() + i))
        };
        let slots = known
            .iter()
            .map(|o| o.neighbours().map(|neighbour| neighbour.and_then(|n| row(o, n.track_index()))).0)
            .collect();
        Self { known, late: met, slots }
    }
}

impl Gnp {
    /// The scene of each window with neighbours that were rolled out together beforehand, each
    /// towards its own likeliest goal and pushed by the others. The target's own alternatives
    /// (`ends` `[batch, k, 2]`) are then driven among these paths: they do not react to the less
    /// likely ones. Vehicles without a whole observed past keep their velocity.
    pub(crate) fn joint_scene(&self, situations: &[Situation<'_>], ends: Tensor) -> Result<RollOutBatch, ModelError> {
        let crowd = Crowd::around(situations);
        let paths = self.joint_paths(&crowd)?;
        let t_pred = self.shape().t_pred;
        let mut futures = vec![0f32; situations.len() * t_pred * SLOTS * 4];
        let rows: BTreeMap<_, _> = crowd.known.iter().enumerate().map(|(row, o)| (o.key(), row)).collect();
        for (b, situation) in situations.iter().enumerate() {
            let own = situation.view().observation();
            let Some(&row) = rows.get(&own.key()) else { continue };
            for slot in 0..SLOTS {
                let Some(other) = crowd.slots[row][slot] else { continue };
                let offset = difference(crowd.origin(other), own.origin());
                for j in 0..t_pred {
                    let state = paths[other * t_pred + j];
                    let at = ((b * t_pred + j) * SLOTS + slot) * 4;
                    let moved = [state.x + offset[0], state.y + offset[1], state.vx, state.vy];
                    futures[at..at + 4].copy_from_slice(&moved);
                }
            }
        }
        let futures = Tensor::from_vec(futures, (situations.len(), t_pred, SLOTS, 4), &self.trained.device)?;
        self.trained.features.scene_among(situations, ends, NeighbourStates::Given(futures), &self.trained.device)
    }

    /// States of every vehicle of the crowd when each step sets out, row by row, in its own frame.
    fn joint_paths(&self, crowd: &Crowd<'_>) -> Result<Vec<TrackState>, ModelError> {
        let Some((force, phase)) = &self.trained.force else { return Ok(Vec::new()) };
        let (known, t_pred) = (crowd.known.len(), self.shape().t_pred);
        let situations = self.situations(&crowd.known)?;
        let ends = end_points(&self.goals(&situations, 1)?, &self.trained.device)?;
        let total = known + crowd.late.len();
        let mut index = vec![0u32; total * SLOTS];
        let mut offset = vec![0f32; total * SLOTS * 2];
        let mut present = vec![0f32; total * SLOTS];
        for (row, slots) in crowd.slots.iter().enumerate() {
            for (slot, other) in slots.iter().enumerate() {
                let Some(other) = *other else { continue };
                let at = row * SLOTS + slot;
                let shift = difference(crowd.origin(other), crowd.origin(row));
                index[at] = other as u32;
                offset[2 * at..2 * at + 2].copy_from_slice(&shift);
                present[at] = 1.;
            }
        }
        let states = NeighbourStates::Joint {
            index: Tensor::from_vec(index, (total, SLOTS), &self.trained.device)?,
            offset: Tensor::from_vec(offset, (total, SLOTS, 2), &self.trained.device)?,
        };
        let mut scene = self.trained.features.scene_among(&situations, ends, states, &self.trained.device)?;
        let present = Tensor::from_vec(present, (total, SLOTS), &self.trained.device)?;
        if let Some(neighbours) = &mut scene.neighbours {
            neighbours.present = present;
        }
        self.add_late(&mut scene, crowd)?;
        let out = force.roll_out_explained(&scene, *phase)?;
        let path = out.path.squeeze(1)?;
        let all = Tensor::cat(&[&path, &out.velocity.squeeze(1)?], D::Minus1)?;
        let values = all.flatten_all()?.to_vec1::<f32>()?;
        let now = scene.observed.narrow(1, self.shape().t_obs - 1, 1)?.flatten_all()?.to_vec1::<f32>()?;
        let state = |v: &[f32]| TrackState { x: v[0], y: v[1], vx: v[2], vy: v[3] };
        let mut states = Vec::with_capacity(total * t_pred);
        for (now, steps) in now.chunks_exact(4).zip(values.chunks_exact(4 * t_pred)) {
            states.push(state(now));
            states.extend(steps.chunks_exact(4).take(t_pred - 1).map(state));
        }
        Ok(states)
    }

    /// Appends rows for the vehicles without a whole past: a past and a goal at their velocity,
    /// nobody around them.
    fn add_late(&self, scene: &mut RollOutBatch, crowd: &Crowd<'_>) -> Result<(), ModelError> {
        if crowd.late.is_empty() {
            return Ok(());
        }
        let shape = self.shape();
        let (n, dt) = (crowd.late.len(), shape.dt() as f32);
        let (mut observed, mut goals) = (Vec::with_capacity(n * shape.t_obs * 4), Vec::with_capacity(n * 2));
        let window = self.trained.features.config().velocity_window_s;
        let horizon = shape.t_pred as f32 * dt;
        for late in &crowd.late {
            let now = velocity_of(&late.neighbour, shape, window);
            for i in 0..shape.t_obs {
                let t = (shape.t_obs - 1 - i) as f32 * dt;
                observed.extend([-now[0] * t, -now[1] * t, now[0], now[1]]);
            }
            goals.extend([now[0] * horizon, now[1] * horizon]);
        }
        let observed = Tensor::from_vec(observed, (n, shape.t_obs, 4), &self.trained.device)?;
        let goals = Tensor::from_vec(goals, (n, 1, 2), &self.trained.device)?;
        scene.observed = Tensor::cat(&[&scene.observed, &observed], 0)?;
        scene.goals = Tensor::cat(&[&scene.goals, &goals], 0)?;
        if let Some(lines) = &mut scene.lines {
            let m = lines.present.dim(1)?;
            let none = |tensor: &Tensor, shape: &[usize]| Tensor::zeros(shape, tensor.dtype(), tensor.device());
            lines.lines = Tensor::cat(&[&lines.lines, &none(&lines.lines, &[n, m, 3])?], 0)?;
            lines.present = Tensor::cat(&[&lines.present, &none(&lines.present, &[n, m])?], 0)?;
        }
        Ok(())
    }
}

impl Crowd<'_> {
    /// Origin of a row's own frame, m, road frame.
    fn origin(&self, row: usize) -> [f32; 2] {
        match self.known.get(row) {
            Some(observation) => observation.origin(),
            None => {
                let late = &self.late[row - self.known.len()];
                let now = late.neighbour.now();
                [late.origin[0] + now.x, late.origin[1] + now.y]
            }
        }
    }
}

fn difference(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] - b[0], a[1] - b[1]]
}
