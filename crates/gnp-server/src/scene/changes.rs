//! Changes of a scene as a request has them.

use gnp::{Change, ChangeError, ChangeField, ChangeProblem, Names};
use gnp_data::{NewVehicle, SceneEdit, VehicleClass};
use serde::Deserialize;

use super::Scene;
use super::tracks::LONGEST_NAME;
use crate::object::Object;
use crate::problem::{Problem, ProblemKind};

/// Most changes of a request.
const MOST: usize = 500;

/// A change; which fields it has, its kind says.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ChangeRequest {
    kind: ChangeKind,
    vehicle: Option<String>,
    by: Option<[f64; 2]>,
    mps: Option<f64>,
    at: Option<[f64; 2]>,
    class: Option<VehicleClass>,
    size: Option<[f64; 2]>,
    term: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ChangeKind {
    Remove,
    Move,
    Speed,
    Add,
    Goal,
    WithoutTerm,
}

impl ChangeKind {
    /// The fields that it needs, and those that it may have beside them.
    const fn fields(self) -> (&'static [&'static str], &'static [&'static str]) {
        match self {
            Self::Remove => (&["vehicle"], &[]),
            Self::Move => (&["vehicle", "by"], &[]),
            Self::Speed => (&["vehicle", "mps"], &[]),
            Self::Add => (&["vehicle", "at", "mps"], &["class", "size"]),
            Self::Goal => (&["vehicle", "at"], &[]),
            Self::WithoutTerm => (&["term"], &[]),
        }
    }
}

/// The changes of a request, in terms of a moment.
#[derive(Clone, Debug)]
pub(crate) struct Changes<'a> {
    pub(crate) all: Vec<Change>,
    /// Of the scene's vehicles and those that are added.
    pub(crate) names: Names<'a>,
}

impl<'a> Changes<'a> {
    /// # Errors
    /// A problem with the change and its field: one that its kind does not have, a vehicle that is not in the scene.
    pub(crate) fn of(requests: &[Object<ChangeRequest>], scene: &'a Scene) -> Result<Self, Problem> {
        if requests.len() > MOST {
            let detail = format!("there are {}; at most {MOST} are taken", requests.len());
            return Err(Problem::at(ProblemKind::InvalidRequest, "changes", detail));
        }
        let mut changes = Self { all: Vec::new(), names: Names::of(&scene.moment) };
        for (i, request) in requests.iter().enumerate() {
            let change = changes.one(request, scene, &|name: &str| format!("changes[{i}].{name}"))?;
            changes.all.push(change);
        }
        Ok(changes)
    }

    /// The carriageway of a vehicle that is added.
    pub(crate) fn road_of_added(&self, vehicle: u32) -> Option<u16> {
        self.all.iter().find_map(|change| match change {
            Change::Scene(SceneEdit::Add(new)) if new.vehicle == vehicle => Some(new.road),
            _ => None,
        })
    }

    fn one(
        &mut self,
        request: &ChangeRequest,
        scene: &Scene,
        field: &dyn Fn(&str) -> String,
    ) -> Result<Change, Problem> {
        request.check(field)?;
        let missing = |name: &str| Problem::at(ProblemKind::InvalidRequest, field(name), "is missing");
        let vehicle = || -> Result<u32, Problem> {
            let name = request.vehicle.as_deref().ok_or_else(|| missing("vehicle"))?;
            let named = self.names.number(name);
            named.map_err(|error| Problem::at(ProblemKind::UnknownVehicle, field("vehicle"), error.to_string()))
        };
        let speed_mps = || request.mps.map(|speed| speed as f32).ok_or_else(|| missing("mps"));
        let at = || request.at.ok_or_else(|| missing("at"));
        Ok(match request.kind {
            ChangeKind::Remove => SceneEdit::Remove { vehicle: vehicle()? }.into(),
            ChangeKind::Move => {
                SceneEdit::Move { vehicle: vehicle()?, by: single(request.by.ok_or_else(|| missing("by"))?) }.into()
            }
            ChangeKind::Speed => SceneEdit::Speed { vehicle: vehicle()?, speed_mps: speed_mps()? }.into(),
            ChangeKind::Goal => Change::Goal { vehicle: vehicle()?, at: single(at()?) },
            ChangeKind::WithoutTerm => Change::WithoutTerm(request.term.clone().ok_or_else(|| missing("term"))?),
            ChangeKind::Add => {
                let name = request.vehicle.clone().ok_or_else(|| missing("vehicle"))?;
                let (at, speed_mps) = (at()?, speed_mps()?);
                self.add(request, name, at, speed_mps, scene, field)?
            }
        })
    }

    fn add(
        &mut self,
        request: &ChangeRequest,
        name: String,
        at: [f64; 2],
        speed_mps: f32,
        scene: &Scene,
        field: &dyn Fn(&str) -> String,
    ) -> Result<Change, Problem> {
        let wrong = |name: &str, detail: String| Problem::at(ProblemKind::InvalidChange, field(name), detail);
        if name.is_empty() || name.chars().count() > LONGEST_NAME || name.chars().any(char::is_control) {
            return Err(wrong("vehicle", format!("a name has 1 to {LONGEST_NAME} characters, none of control")));
        }
        if self.names.is_taken(&name) {
            return Err(wrong(
                "vehicle",
                format!(
                    "{name} is the name of another vehicle of this scene, or was; give the new one a name of its own"
                ),
            ));
        }
        let class = request.class.unwrap_or(VehicleClass::Car);
        let size = request.size.map_or_else(|| class.default_size(), single);
        let (road, at) =
            scene.road_at(at).ok_or_else(|| wrong("at", "this place is not on the scene's road".to_owned()))?;
        let vehicle = self.names.add(name.clone());
        let vehicle = vehicle.ok_or_else(|| wrong("vehicle", "no more vehicles can be added".to_owned()))?;
        Ok(SceneEdit::Add(NewVehicle { vehicle, name: Some(name), road, at, speed_mps, class, size }).into())
    }
}

/// In the precision of scenes, which refuse what is infinite in it.
fn single(values: [f64; 2]) -> [f32; 2] {
    values.map(|value| value as f32)
}

impl ChangeRequest {
    /// Refuses fields that the kind does not have, and lacks.
    fn check(&self, field: &dyn Fn(&str) -> String) -> Result<(), Problem> {
        let (needed, possible) = self.kind.fields();
        let there = [
            ("vehicle", self.vehicle.is_some()),
            ("by", self.by.is_some()),
            ("mps", self.mps.is_some()),
            ("at", self.at.is_some()),
            ("class", self.class.is_some()),
            ("size", self.size.is_some()),
            ("term", self.term.is_some()),
        ];
        for (name, there) in there {
            let detail = match (there, needed.contains(&name)) {
                (true, false) if !possible.contains(&name) => {
                    format!(
                        "a change of this kind has no such field; it has {}",
                        [needed, possible].concat().join(", ")
                    )
                }
                (false, true) => "is missing".to_owned(),
                _ => continue,
            };
            return Err(Problem::at(ProblemKind::InvalidRequest, field(name), detail));
        }
        Ok(())
    }
}

/// What a change is refused for.
pub(crate) fn refused(error: &ChangeError) -> Problem {
    let kind = match &error.problem {
        ChangeProblem::Unknown(_) | ChangeProblem::Absent { .. } => ProblemKind::UnknownVehicle,
        ChangeProblem::Term(_) => ProblemKind::UnknownTerm,
        _ => ProblemKind::InvalidChange,
    };
    let field = match error.field() {
        ChangeField::By => "by",
        ChangeField::Speed => "mps",
        ChangeField::At => "at",
        ChangeField::Size => "size",
        ChangeField::Term => "term",
        _ => "vehicle",
    };
    Problem::at(kind, format!("changes[{}].{field}", error.index), error.problem.to_string())
}
