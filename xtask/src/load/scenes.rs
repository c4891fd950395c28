//! What the server is asked under load: scenes out of the recordings that it has, as a program and as its page send them.

use anyhow::{Context as _, Result};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::serve::Server;

/// Vehicles of the scene that a program sends.
pub(super) const VEHICLES: usize = 20;
/// What is observed of each, s.
const OBSERVED_S: f64 = 3.;
/// Vehicles of the scene that the page shows; what the fullest moment lacks is added to it.
const SHOWN: usize = 60;
/// From one added vehicle to the next, m, and its speed, m/s.
const ADDED: (f64, f64) = (25., 15.);
/// What is looked at of each recording, s.
const SPAN_S: f64 = 60.;
/// A vehicle is behind another one that is no farther to its side, m.
const BESIDE: f64 = 2.;

/// Bodies of requests, as JSON.
#[derive(Debug)]
pub(super) struct Scenes {
    /// Tracks of [`VEHICLES`], to be predicted.
    pub(super) of_program: String,
    /// Number of vehicles of the page's scene, and how many of them were recorded.
    pub(super) shown: usize,
    pub(super) recorded: usize,
    /// That moment, changed, to be predicted.
    pub(super) predict: String,
    /// The same, to be explained.
    pub(super) explain: String,
}

#[derive(Debug, Deserialize)]
struct Listed {
    recordings: Vec<Recording>,
}

#[derive(Debug, Deserialize)]
struct Recording {
    name: String,
    from_s: f64,
    to_s: f64,
    roads: Vec<Road>,
}

#[derive(Debug, Deserialize)]
struct Road {
    index: usize,
    lines: Value,
}

#[derive(Debug, Deserialize)]
struct Tracks {
    rate_hz: f64,
    from_s: f64,
    frames: usize,
    vehicles: Vec<Vehicle>,
}

/// Places in cm: the first, then differences.
#[derive(Debug, Deserialize)]
struct Vehicle {
    id: String,
    class: String,
    size: Value,
    first: usize,
    x: Vec<i64>,
    y: Vec<i64>,
}

/// A road of a recording, and what drives on it.
struct Stretch {
    recording: String,
    road: Road,
    tracks: Tracks,
}

impl Vehicle {
    fn is_there(&self, frame: usize) -> bool {
        (self.first..self.first + self.x.len()).contains(&frame)
    }

    /// Its centre, m; `None` where it is not there.
    fn at(&self, frame: usize) -> Option<[f64; 2]> {
        let steps = frame.checked_sub(self.first).filter(|_| self.is_there(frame))?;
        Some([&self.x, &self.y].map(|cm| cm[..=steps].iter().sum::<i64>() as f64 / 100.))
    }
}

impl Stretch {
    /// The frame that most of `picked` are in, and their number.
    fn fullest(&self, picked: impl Fn(&Vehicle, usize) -> bool) -> (usize, usize) {
        let count = |frame: usize| self.tracks.vehicles.iter().filter(|one| picked(one, frame)).count();
        // Of equals the first.
        (0..self.tracks.frames)
            .rev()
            .map(|frame| (frame, count(frame)))
            .max_by_key(|(_, count)| *count)
            .unwrap_or((0, 0))
    }

    /// Frames of [`OBSERVED_S`].
    fn steps(&self) -> usize {
        (OBSERVED_S * self.tracks.rate_hz).round() as usize
    }

    fn time_s(&self, frame: usize) -> f64 {
        self.tracks.from_s + frame as f64 / self.tracks.rate_hz
    }
}

impl Scenes {
    /// Asks the server what it has, and picks scenes.
    ///
    /// # Errors
    /// When it does not answer, or no moment has [`VEHICLES`] vehicles with a full past.
    pub(super) fn of(server: &Server) -> Result<Self> {
        let mut stretches = Vec::new();
        let listed: Listed = serde_json::from_str(&server.ask("/v1/recordings", None)?).context("/v1/recordings")?;
        for Recording { name, from_s, to_s, roads } in listed.recordings {
            for road in roads {
                let to_s = to_s.min(from_s + SPAN_S);
                let path = format!("/v1/recordings/{name}/tracks?road={}&from_s={from_s}&to_s={to_s}", road.index);
                let tracks = serde_json::from_str(&server.ask(&path, None)?).context(path)?;
                stretches.push(Stretch { recording: name.clone(), road, tracks });
            }
        }
        let of_program =
            stretches.iter().find_map(of_program).context("no recording has a moment with enough vehicles")?;
        let page =
            stretches.iter().max_by_key(|one| one.fullest(shown(one)).1).context("the server has no recording")?;
        let (frame, recorded) = page.fullest(shown(page));
        let (follower, leader) = pair(&page.tracks.vehicles, frame).context("nobody follows anybody")?;
        let scene = json!({"recording": page.recording, "road": page.road.index, "time_s": page.time_s(frame)});
        let mut changes = vec![json!({"kind": "move", "vehicle": leader, "by": [-3, 0]})];
        let places = page.tracks.vehicles.iter().filter_map(|one| one.at(frame));
        let [x, y] = places.max_by(|a, b| a[0].total_cmp(&b[0])).unwrap_or_default();
        changes.extend((1..=SHOWN.saturating_sub(recorded)).map(|i| {
            let at = [x + ADDED.0 * i as f64, y];
            json!({"kind": "add", "vehicle": format!("new {i}"), "at": at, "mps": ADDED.1, "class": "car", "size": [4.5, 1.8]})
        }));
        let predict = json!({"scene": scene, "changes": changes, "every_s": 0.2}).to_string();
        let explain = json!({"scene": scene, "changes": changes, "vehicle": follower}).to_string();
        Ok(Self { of_program: of_program.to_string(), recorded, shown: recorded.max(SHOWN), predict, explain })
    }
}

/// Who is predicted in a moment of whole pasts: seen twice at least.
fn shown(stretch: &Stretch) -> impl Fn(&Vehicle, usize) -> bool + use<> {
    let steps = stretch.steps();
    move |one, frame| frame >= steps && one.is_there(frame) && one.is_there(frame - 1)
}

/// A request with the tracks of [`VEHICLES`] vehicles, all observed for [`OBSERVED_S`].
fn of_program(stretch: &Stretch) -> Option<Value> {
    let steps = stretch.steps();
    let observed = |one: &Vehicle, frame: usize| frame >= steps && one.is_there(frame) && one.is_there(frame - steps);
    let (last, count) = stretch.fullest(observed);
    if count < VEHICLES {
        return None;
    }
    let track = |vehicle: &Vehicle| -> Vec<[f64; 3]> {
        let frames = last - steps..=last;
        frames.filter_map(|frame| vehicle.at(frame).map(|[x, y]| [stretch.time_s(frame), x, y])).collect()
    };
    let seen = stretch.tracks.vehicles.iter().filter(|one| observed(one, last)).take(VEHICLES);
    let vehicles: Vec<Value> =
        seen.map(|one| json!({"id": one.id, "class": one.class, "size": one.size, "track": track(one)})).collect();
    Some(json!({"scene": {"lines": stretch.road.lines, "vehicles": vehicles}}))
}

/// A vehicle, and who drives nearest ahead of it in its lane: of all pairs the closest with room for a change.
fn pair(vehicles: &[Vehicle], frame: usize) -> Option<(&str, &str)> {
    let there: Vec<_> = vehicles.iter().filter_map(|one| Some((one.id.as_str(), one.at(frame)?))).collect();
    let pairs = there.iter().flat_map(|(behind, [x, y])| {
        there.iter().map(move |(ahead, [far, aside])| ((*behind, *ahead), far - x, (aside - y).abs()))
    });
    let near = pairs.filter(|(_, gap, aside)| *aside < BESIDE && *gap > 10.);
    near.min_by(|(_, a, _), (_, b, _)| a.total_cmp(b)).map(|(pair, ..)| pair)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vehicle(id: &str, first: usize, x: Vec<i64>, y: i64) -> Vehicle {
        let still = [vec![y], vec![0; x.len() - 1]].concat();
        Vehicle { id: id.to_owned(), class: "car".to_owned(), size: json!([4.5, 1.8]), first, x, y: still }
    }

    #[test]
    fn places_are_sums_of_differences() {
        let one = vehicle("7", 2, vec![1000, 150, 150], 350);
        assert_eq!([1, 2, 4, 5].map(|frame| one.at(frame)), [None, Some([10., 3.5]), Some([13., 3.5]), None]);
    }

    #[test]
    fn a_follower_and_its_leader_are_in_one_lane() {
        let all = [
            vehicle("behind", 0, vec![0], 0),
            vehicle("beside", 0, vec![1500], 360),
            vehicle("ahead", 0, vec![3000], 50),
            vehicle("gone", 5, vec![1200], 0),
        ];
        assert_eq!(pair(&all, 0), Some(("behind", "ahead")));
        assert_eq!(pair(&all[..2], 0), None);
    }

    #[test]
    fn a_program_sends_vehicles_with_a_full_past() {
        let mut vehicles: Vec<_> = (0..VEHICLES).map(|i| vehicle(&i.to_string(), 0, vec![100; 40], 0)).collect();
        let tracks = |vehicles| Tracks { rate_hz: 10., from_s: 5., frames: 60, vehicles };
        vehicles.push(vehicle("late", 30, vec![100; 10], 0));
        let road = || Road { index: 0, lines: json!([]) };
        let stretch = Stretch { recording: "a".to_owned(), road: road(), tracks: tracks(vehicles) };
        let body = of_program(&stretch).unwrap();
        let sent = body["scene"]["vehicles"].as_array().unwrap();
        assert_eq!(sent.len(), VEHICLES);
        assert_eq!(sent[0]["track"].as_array().unwrap().len(), 31);
        assert_eq!(sent[0]["track"][30], json!([8., 31., 0.]));
        let few =
            Stretch { recording: "a".to_owned(), road: road(), tracks: tracks(vec![vehicle("1", 0, vec![0; 40], 0)]) };
        assert!(of_program(&few).is_none());
    }
}
