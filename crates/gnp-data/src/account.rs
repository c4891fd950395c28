//! What is behind one path, cause by cause, for people: numbers at any time, and a sentence.

use std::collections::BTreeMap;

use crate::explanation::{Cause, Contribution};
use crate::predictor::Mode;
use crate::recording::Recording;

/// Parts below this are not worth a word, m.
const NAMED: f32 = 0.1;
/// Parts that a sentence names, at most.
const MOST_NAMED: usize = 5;
/// Lateral displacement that is worth a word, m.
const SIDEWAYS: f32 = 0.5;

/// One path come apart: constant velocity and the parts of all causes add up to it, along the road and across.
#[derive(Clone, Debug, PartialEq)]
pub struct Account {
    /// Number of the vehicle.
    pub vehicle: u32,
    /// Period of the predicted frames, s.
    pub dt: f64,
    /// Velocity at the last observed frame, m/s, window frame.
    pub velocity: [f32; 2],
    /// What moved the vehicle away from where that leads.
    pub parts: Vec<Contribution>,
    /// Centre in each predicted frame, m, window frame.
    pub path: Vec<[f32; 2]>,
    /// Names of vehicles that are called otherwise than by their number.
    pub names: BTreeMap<u32, String>,
}

impl Account {
    /// The account of a forecast future; `None` for one whose contributions were not asked for.
    #[must_use]
    pub fn of(vehicle: u32, mode: &Mode, dt: f64) -> Option<Self> {
        let explanation = mode.explanation.as_ref().filter(|it| !it.contributions.is_empty())?;
        let (velocity, parts) = (explanation.velocity, explanation.contributions.clone());
        Some(Self { vehicle, dt, velocity, parts, path: mode.path.clone(), names: BTreeMap::new() })
    }

    /// The same, in which vehicles are called as in `recording`.
    #[must_use]
    pub fn named_as_in(mut self, recording: &Recording) -> Self {
        let others = self.parts.iter().filter_map(|part| part.cause.vehicle());
        for vehicle in others.chain([self.vehicle]) {
            let name = recording.vehicle_name(vehicle);
            if name != vehicle.to_string() {
                self.names.insert(vehicle, name.into_owned());
            }
        }
        self
    }

    /// What a vehicle is called.
    #[must_use]
    pub fn name(&self, vehicle: u32) -> String {
        self.names.get(&vehicle).cloned().unwrap_or_else(|| vehicle.to_string())
    }

    /// What a cause is called, such as `leader 7`.
    #[must_use]
    pub fn cause_name(&self, cause: &Cause) -> String {
        let words = cause.to_string();
        match cause.vehicle().filter(|vehicle| self.names.contains_key(vehicle)) {
            Some(vehicle) => words.replacen(&vehicle.to_string(), &self.name(vehicle), 1),
            None => words,
        }
    }

    /// Number of predicted frames.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.path.len()
    }

    /// The step that is `seconds` ahead, or the nearest there is.
    #[must_use]
    pub fn step_at(&self, seconds: f64) -> usize {
        ((seconds / self.dt).round().max(0.) as usize).min(self.steps())
    }

    /// Where constant velocity leads in `step` steps, m.
    #[must_use]
    pub fn constant_velocity(&self, step: usize) -> [f32; 2] {
        self.velocity.map(|speed| (f64::from(speed) * self.dt * step as f64) as f32)
    }

    /// The sum of all parts after `step` steps, m.
    #[must_use]
    pub fn sum(&self, step: usize) -> [f32; 2] {
        self.parts.iter().map(|part| part.after(step)).fold([0.; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]])
    }

    /// Where the path is after `step` steps, m.
    #[must_use]
    pub fn path_at(&self, step: usize) -> [f32; 2] {
        step.checked_sub(1).and_then(|step| self.path.get(step)).copied().unwrap_or_default()
    }

    /// What `changed` is more than this, cause by cause; one that is in one of them alone counts as 0 in the other. The
    /// result adds up as the two do: its velocity and path are differences, too.
    #[must_use]
    pub fn change_to(&self, changed: &Self) -> Self {
        let steps = self.steps().min(changed.steps());
        let part = |all: &[Contribution], cause: &Cause| all.iter().find(|part| part.cause.is_same_as(cause)).cloned();
        let new = changed.parts.iter().filter(|it| part(&self.parts, &it.cause).is_none());
        let difference = |cause: &Cause| {
            let after = |all, step| part(all, cause).map_or([0.; 2], |part| part.after(step));
            let less = |step| less(after(&changed.parts, step), after(&self.parts, step));
            Contribution { cause: cause.clone(), displacement: (1..=steps).map(less).collect() }
        };
        Self {
            vehicle: self.vehicle,
            dt: self.dt,
            velocity: less(changed.velocity, self.velocity),
            parts: self.parts.iter().chain(new).map(|part| difference(&part.cause)).collect(),
            path: (1..=steps).map(|step| less(changed.path_at(step), self.path_at(step))).collect(),
            names: self.names.iter().chain(&changed.names).map(|(vehicle, name)| (*vehicle, name.clone())).collect(),
        }
    }

    /// How far the vehicle gets by the end, against its present speed, and why: one sentence, the largest parts first.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Self { velocity: [speed, _], .. } = self;
        let vehicle = self.name(self.vehicle);
        let along = self.sum(self.steps())[0];
        let far = match along {
            x if x.abs() < NAMED / 2. => "as far as".to_owned(),
            x => format!("{} {} than", metres(x), if x < 0. { "less far" } else { "farther" }),
        };
        let head = format!("In {} vehicle {vehicle} gets {far} at its present {speed:.1} m/s", self.horizon());
        format!("{}.", [head, self.reasons(phrase), self.sideways()].concat())
    }

    /// The sentence of a [change](Account::change_to) that `what` brought about, such as `Without vehicle 3`.
    #[must_use]
    pub fn sentence_of_change(&self, what: &str) -> String {
        let along = self.path_at(self.steps())[0];
        let far = match along {
            x if x.abs() < NAMED / 2. => "as far as now".to_owned(),
            x => format!("{} {}", metres(x), if x < 0. { "less far" } else { "farther" }),
        };
        let head = format!("{what}, vehicle {} gets {far} in {}", self.name(self.vehicle), self.horizon());
        let start = self.constant_velocity(self.steps())[0];
        let speed = if start.abs() < NAMED { String::new() } else { format!("constant velocity {}, ", signed(start)) };
        let reasons = self.reasons(|_, cause, x| format!("{cause} {}", signed(x)));
        let reasons = match reasons.strip_prefix(": ") {
            Some(reasons) => format!(": {speed}{reasons}"),
            None if !speed.is_empty() => format!(": {}", speed.trim_end_matches(", ")),
            None => String::new(),
        };
        format!("{}.", [head, reasons, self.sideways()].concat())
    }

    fn horizon(&self) -> String {
        let seconds = self.dt * self.steps() as f64;
        format!("{} s", (seconds * 100.).round() / 100.)
    }

    /// The parts along the road at the end, the largest first, small ones together.
    fn reasons(&self, words: impl Fn(&Cause, &str, f32) -> String) -> String {
        let end = self.steps();
        let mut parts: Vec<(&Cause, f32)> = self.parts.iter().map(|it| (&it.cause, it.after(end)[0])).collect();
        parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        let named = parts.iter().take(MOST_NAMED).take_while(|(_, x)| x.abs() >= NAMED).count();
        let rest: f32 = parts[named..].iter().map(|(_, x)| x).sum();
        let mut reasons: Vec<String> =
            parts[..named].iter().map(|(cause, x)| words(cause, &self.cause_name(cause), *x)).collect();
        if rest.abs() >= NAMED / 2. {
            reasons.push(format!("the rest {}", signed(rest)));
        }
        if reasons.is_empty() { String::new() } else { format!(": {}", reasons.join(", ")) }
    }

    fn sideways(&self) -> String {
        let end = self.steps();
        let [_, across] = self.sum(end);
        if across.abs() < SIDEWAYS {
            return String::new();
        }
        let side = if across > 0. { "left" } else { "right" };
        let most = self.parts.iter().max_by(|a, b| a.after(end)[1].abs().total_cmp(&b.after(end)[1].abs()));
        let by = most.map_or_else(String::new, |part| format!(", most of it by {}", self.cause_name(&part.cause)));
        format!("; sideways it ends {} farther {side}{by}", metres(across))
    }
}

/// `called` is the name of the cause.
fn phrase(cause: &Cause, called: &str, x: f32) -> String {
    let (length, back) = (metres(x), x < 0.);
    let way = |back_words: &str, on_words: &str| if back { back_words.to_owned() } else { on_words.to_owned() };
    match cause {
        Cause::FreeRoad => format!("the driver alone would get {length} {}", way("less far", "farther")),
        Cause::Leader { .. } => format!("{called} {} by {length}", way("holds it back", "draws it on")),
        Cause::FartherLeaders => format!("{called} {} by {length}", way("hold it back", "draw it on")),
        Cause::Intention => format!("the network expects {length} {}", way("less", "more")),
        Cause::Neighbour { .. } => format!("{called} {} by {length}", way("pushes it back", "pushes it on")),
        Cause::Neighbours => format!("{called} {} by {length}", way("push it back", "push it on")),
        Cause::Term(_) => format!("{called} {} {length}", way("take", "add")),
    }
}

fn metres(x: f32) -> String {
    format!("{:.1} m", x.abs())
}

/// With its sign, a true minus.
fn signed(x: f32) -> String {
    format!("{}{}", if x < 0. { '\u{2212}' } else { '+' }, metres(x))
}

fn less(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explanation::Explanation;

    fn leader(vehicle: u32, place: usize) -> Cause {
        Cause::Leader { vehicle, place }
    }

    /// An account over two steps of 2.5 s at 13.2 m/s; a part's displacement grows as 1:4.
    fn account(parts: &[(Cause, [f32; 2])]) -> Account {
        let part = |(cause, end): &(Cause, [f32; 2])| Contribution {
            cause: cause.clone(),
            displacement: vec![end.map(|x| x / 4.), *end],
        };
        let explanation = Explanation {
            velocity: [13.2, 0.1],
            contributions: parts.iter().map(part).collect(),
            ..Explanation::default()
        };
        let mode = Mode { probability: 1., path: explanation.path(2.5), explanation: Some(explanation) };
        Account::of(12, &mode, 2.5).unwrap()
    }

    fn as_it_is() -> Account {
        account(&[
            (Cause::FreeRoad, [0.6, -0.1]),
            (leader(34, 1), [-11., 0.]),
            (leader(35, 2), [-0.2, 0.]),
            (Cause::Intention, [1.2, 0.]),
            (Cause::Neighbour { vehicle: 7 }, [0.04, 0.]),
            (Cause::Term("lines".to_owned()), [0.02, 0.1]),
        ])
    }

    fn close(a: [f32; 2], b: [f32; 2]) {
        assert!((a[0] - b[0]).abs() < 1e-4 && (a[1] - b[1]).abs() < 1e-4, "{a:?} {b:?}");
    }

    #[test]
    fn velocity_and_parts_add_up_at_every_step() {
        let account = as_it_is();
        for step in 0..=2 {
            let ([x, y], [dx, dy]) = (account.constant_velocity(step), account.sum(step));
            close([x + dx, y + dy], account.path_at(step));
        }
        assert_eq!((account.step_at(2.4), account.step_at(60.), account.step_at(-1.)), (1, 2, 0));
        assert!(Account::of(1, &Mode::default(), 0.1).is_none());
    }

    #[test]
    fn the_sentence_names_the_largest_first_and_sums_up_the_rest() {
        assert_eq!(
            as_it_is().sentence(),
            "In 5 s vehicle 12 gets 9.3 m less far than at its present 13.2 m/s: leader 34 holds it back by 11.0 m, the \
             network expects 1.2 m more, the driver alone would get 0.6 m farther, leader 35 (2 ahead) holds it \
             back by 0.2 m, the rest +0.1 m."
        );
        let still = account(&[(Cause::FreeRoad, [0.01, 0.]), (Cause::Intention, [0., 3.5])]);
        assert_eq!(
            still.sentence(),
            "In 5 s vehicle 12 gets as far as at its present 13.2 m/s; sideways it ends 3.5 m farther left, most of it by \
             intention."
        );
    }

    #[test]
    fn a_change_adds_up_and_a_leader_stays_himself_in_another_place() {
        let (before, after) = (as_it_is(), account(&[(leader(35, 1), [-2.2, 0.]), (leader(36, 2), [-0.5, 0.])]));
        let change = before.change_to(&after);
        let of = |cause: Cause| change.parts.iter().find(|part| part.cause.is_same_as(&cause)).unwrap().at_end();
        close(of(leader(34, 1)), [11., 0.]);
        close(of(leader(35, 1)), [-2., 0.]);
        close(of(leader(36, 2)), [-0.5, 0.]);
        close(of(Cause::Intention), [-1.2, 0.]);
        for step in 1..=2 {
            let ([x, y], [dx, dy]) = (change.constant_velocity(step), change.sum(step));
            close([x + dx, y + dy], change.path_at(step));
        }
        assert_eq!(
            change.sentence_of_change("Without vehicle 34"),
            "Without vehicle 34, vehicle 12 gets 6.6 m farther in 5 s: leader 34 +11.0 m, leader 35 (2 ahead) \u{2212}2.0 m, \
             intention \u{2212}1.2 m, free road \u{2212}0.6 m, leader 36 (2 ahead) \u{2212}0.5 m, the rest \u{2212}0.1 m."
        );
        assert_eq!(
            before.change_to(&before).sentence_of_change("With nothing"),
            "With nothing, vehicle 12 gets as far as now in 5 s."
        );
        let slower = Account { velocity: [10.2, 0.1], ..before.clone() };
        let told = before.change_to(&slower).sentence_of_change("Slower");
        assert!(told.contains(": constant velocity \u{2212}15.0 m."), "{told}");
    }
}
