//! One scene of known metres, written in every layout and on both carriageways, gives the same
//! windows; its mirror image gives mirrored ones; rows after the last observed frame do not count.

#![allow(clippy::unwrap_used)] // also outside the test functions

use std::fmt::Write as _;
use std::path::Path;

use gnp_data::{
    Dataset, Expectation, MarkingKind, Observation, Recording, SLOTS, Slot, TrackState, Window, WindowConfig,
    WindowSet, discover, read,
};

/// Frames of the scene; all vehicles are there from the first to the last, numbered from 1.
const FRAMES: u32 = 84;
/// Feet in a metre.
const FEET: f64 = 1. / 0.3048;
/// Lane lines of the scene, m, from right to left. Lanes differ in width so that a mirror shows.
const LINES: [f64; 4] = [-6., -2., 1.75, 5.25];
/// Length and width of every vehicle, m.
const SIZE: [f64; 2] = [4.5, 1.75];
/// Vehicle numbers in the target's slots.
const TARGET_SLOTS: [u32; SLOTS] = [2, 3, 0, 4, 0, 5, 0, 6];

/// A vehicle's centre at a time, m, in the road frame, and its lane from the left, from 1.
struct Vehicle {
    start: [f64; 2],
    velocity: [f64; 2],
    lane: u32,
}

/// The target in the middle lane, drifting to the left; others in the slots of [`TARGET_SLOTS`].
fn vehicles() -> [Vehicle; 6] {
    let vehicle = |x, y, vx, vy, lane| Vehicle { start: [x, y], velocity: [vx, vy], lane };
    [
        vehicle(100., -0.5, 22., 0.125, 2),
        vehicle(130., -0.25, 24., 0., 2),
        vehicle(70., 0.25, 21., 0., 2),
        vehicle(101., 3.5, 22.5, 0., 1),
        vehicle(120., -4., 23., -0.0625, 3),
        vehicle(85., -3.75, 20., 0., 3),
    ]
}

impl Vehicle {
    fn at(&self, time: f64) -> [f64; 2] {
        [self.start[0] + self.velocity[0] * time, self.start[1] + self.velocity[1] * time]
    }
}

/// How the scene is put into highD's image, whose y points down.
#[derive(Clone, Copy, PartialEq)]
enum Layout {
    /// Direction 2: to the right in the image.
    Lower,
    /// Direction 1: turned by half a turn.
    Upper,
    /// Direction 2 of the scene seen in a mirror along the road.
    LowerMirrored,
}

/// Width and height of the image, m.
const IMAGE: [f64; 2] = [420., 40.];

impl Layout {
    /// Centre in the image of a point of the road.
    fn image(self, [x, y]: [f64; 2]) -> [f64; 2] {
        match self {
            Self::Lower => [x, 30. - y],
            Self::Upper => [IMAGE[0] - x, IMAGE[1] - (30. - y)],
            Self::LowerMirrored => [x, 30. + y],
        }
    }

    /// Velocity in the image.
    fn velocity(self, [vx, vy]: [f64; 2]) -> [f64; 2] {
        match self {
            Self::Lower => [vx, -vy],
            Self::Upper => [-vx, vy],
            Self::LowerMirrored => [vx, vy],
        }
    }

    fn slot(self, slot: Slot) -> Slot {
        if self == Self::LowerMirrored { slot.mirrored() } else { slot }
    }
}

/// Vehicles in the slots of each vehicle, by lane and place; all keep their places over the scene.
fn slots_of(me: usize) -> [u32; SLOTS] {
    let all = vehicles();
    let mut slots = [0; SLOTS];
    let mut nearest = [f64::INFINITY; SLOTS];
    for (other, it) in all.iter().enumerate().filter(|(other, _)| *other != me) {
        let gap = it.start[0] - all[me].start[0];
        let place = if gap.abs() < SIZE[0] { 1 } else { usize::from(gap < 0.) * 2 };
        let slot = match i64::from(it.lane) - i64::from(all[me].lane) {
            0 => [Slot::Preceding, Slot::Preceding, Slot::Following][place],
            -1 => [Slot::LeftPreceding, Slot::LeftAlongside, Slot::LeftFollowing][place],
            1 => [Slot::RightPreceding, Slot::RightAlongside, Slot::RightFollowing][place],
            _ => continue,
        };
        if gap.abs() < nearest[slot as usize] {
            nearest[slot as usize] = gap.abs();
            slots[slot as usize] = other as u32 + 1;
        }
    }
    slots
}

/// Where a row of a changed scene takes its place from: after `t0` everybody goes at half the speed, since rows that
/// jump about, and velocities that are not those of positions, are refused.
fn source_frame(frame: u32, t0: Option<u32>) -> u32 {
    t0.map_or(frame, |t0| frame.min(t0) + frame.saturating_sub(t0) / 2)
}

/// Writes the scene as one highD recording, changed after `scrambled`, from where on nobody has neighbours either.
fn write_highd(folder: &Path, layout: Layout, rate: f64, scrambled: Option<u32>) {
    let mut tracks = String::from(
        "frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,frontSightDistance,\
         backSightDistance,dhw,thw,ttc,precedingXVelocity,precedingId,followingId,leftPrecedingId,leftAlongsideId,\
         leftFollowingId,rightPrecedingId,rightAlongsideId,rightFollowingId,laneId\n",
    );
    let mut meta = String::from(
        "id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection,traveledDistance,minXVelocity,\
         maxXVelocity,meanXVelocity,minDHW,minTHW,minTTC,numLaneChanges\n",
    );
    let direction = if layout == Layout::Upper { 1 } else { 2 };
    for (index, vehicle) in vehicles().iter().enumerate() {
        let id = index + 1;
        let mut by_slot = [0; SLOTS];
        for slot in Slot::ALL {
            by_slot[layout.slot(slot) as usize] = slots_of(index)[slot as usize];
        }
        for frame in 1..=FRAMES {
            let source = source_frame(frame, scrambled);
            let [x, y] = layout.image(vehicle.at(f64::from(source) / rate));
            let [vx, vy] = layout.velocity(vehicle.velocity);
            let (corner_x, corner_y) = (x - SIZE[0] / 2., y - SIZE[1] / 2.);
            let after = scrambled.is_some_and(|t0| frame > t0);
            let vx = if after { vx / 2. } else { vx };
            let lane = 3 + vehicle.lane;
            let ids = if after { [0; SLOTS] } else { by_slot }.map(|id| id.to_string()).join(",");
            writeln!(
                tracks,
                "{frame},{id},{corner_x:.4},{corner_y:.4},{},{},{vx:.4},{vy:.4},0,0,0,0,0,0,0,0,{ids},{lane}",
                SIZE[0], SIZE[1]
            )
            .unwrap();
        }
        let [length, width] = SIZE;
        writeln!(meta, "{id},{length},{width},1,{FRAMES},{FRAMES},Car,{direction},90,20,24,22,-1,-1,-1,0").unwrap();
    }
    let mut lines: Vec<f64> = LINES.iter().map(|y| layout.image([0., *y])[1]).collect();
    lines.sort_by(f64::total_cmp);
    let here = lines.iter().map(|y| format!("{y:.2}")).collect::<Vec<_>>().join(";");
    // The other carriageway of the image has lanes, and nobody on them.
    let (upper, lower) =
        if layout == Layout::Upper { (here, "28.00;32.00".into()) } else { ("2.00;6.00".into(), here) };
    let recording = format!(
        "id,frameRate,locationId,speedLimit,month,weekDay,startTime,duration,totalDrivenDistance,totalDrivenTime,\
         numVehicles,numCars,numTrucks,upperLaneMarkings,lowerLaneMarkings\n\
         1,{rate},2,-1,9.2017,Tue,08:38,8,1,1,6,6,0,{upper},{lower}\n"
    );
    for (name, text) in [("tracks", tracks), ("tracksMeta", meta), ("recordingMeta", recording)] {
        std::fs::write(folder.join(format!("01_{name}.csv")), text).unwrap();
    }
}

/// Writes the scene in NGSIM's columns, in feet, changed after `scrambled`.
fn write_ngsim(folder: &Path, scrambled: Option<u32>) {
    let mut text = String::from(
        "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_Length,v_Width,v_Class,\
         v_Vel,v_Acc,Lane_ID,Preceding,Following,Space_Headway,Time_Headway,Location\n",
    );
    for (index, vehicle) in vehicles().iter().enumerate() {
        for frame in 1..=FRAMES {
            let source = source_frame(frame, scrambled);
            let [x, y] = vehicle.at(f64::from(source) / 10.);
            let (front, right) = ((x + SIZE[0] / 2.) * FEET, (LINES[3] - y) * FEET);
            let [length, width] = SIZE.map(|metres| metres * FEET);
            let time = 1_118_846_980_000 + u64::from(frame) * 100;
            writeln!(
                text,
                "{},{frame},{FRAMES},{time},{right:.4},{front:.4},0,0,{length:.4},{width:.4},2,{:.3},0,{},0,0,0,0,us-101",
                index + 1,
                vehicle.velocity[0] * FEET * if scrambled.is_some_and(|t0| frame > t0) { 0.5 } else { 1. },
                vehicle.lane,
            )
            .unwrap();
        }
    }
    std::fs::write(folder.join("scene.csv"), text).unwrap();
}

fn read_one(folder: &Path, dataset: Dataset) -> Recording {
    let sources = discover(folder, dataset).unwrap();
    assert_eq!(sources.len(), 1);
    let mut recordings = read(&sources[0], &Expectation { dataset, rate_hz: None }).unwrap();
    assert_eq!(recordings.len(), 1);
    recordings.remove(0).0
}

fn highd(layout: Layout, rate: f64, scrambled: Option<u32>) -> Recording {
    let folder = tempfile::tempdir().unwrap();
    write_highd(folder.path(), layout, rate, scrambled);
    read_one(folder.path(), Dataset::HIGHD)
}

fn ngsim(scrambled: Option<u32>) -> Recording {
    let folder = tempfile::tempdir().unwrap();
    write_ngsim(folder.path(), scrambled);
    read_one(folder.path(), Dataset::NGSIM)
}

fn config(rate_hz: f64) -> WindowConfig {
    let frames = |count: f64| count / rate_hz;
    WindowConfig {
        observed_s: frames(30.),
        predicted_s: frames(50.),
        rate_hz,
        stride_s: frames(1.),
        site_stride_s: Default::default(),
    }
}

/// Every window shows the known metres, with left and right exchanged in the mirror image.
fn assert_golden(recordings: &[Recording], rate: f64, layout: Layout) {
    let side = if layout == Layout::LowerMirrored { -1. } else { 1. };
    let (set, drops) = WindowSet::cut(recordings, &config(rate)).unwrap();
    assert_eq!((set.len(), drops.total().vehicles), (6 * 4, 6), "84 frames hold 4 windows of 81");
    for window in set.iter() {
        let key = window.key();
        let me = key.vehicle as usize - 1;
        let all = vehicles();
        let now = f64::from(key.t0) / rate;
        let origin = all[me].at(now);
        let expected = |vehicle: &Vehicle, frames: f64| {
            let [x, y] = vehicle.at(now + frames / rate);
            [x - origin[0], side * (y - origin[1]), vehicle.velocity[0], side * vehicle.velocity[1]]
        };
        let near = |state: TrackState, wanted: [f64; 4], what: &str| {
            let found = [state.x, state.y, state.vx, state.vy].map(f64::from);
            // A tenth of a millimetre is written; differentiating it at 10 Hz leaves 2 mm/s.
            let far = found.iter().zip(wanted).zip([2e-3, 2e-3, 8e-3, 8e-3]).any(|((a, b), eps)| (a - b).abs() > eps);
            assert!(!far, "{key:?}, {what}: {found:?} instead of {wanted:?}");
        };
        let (observation, truth) = (window.observation(), window.truth());
        for i in 0..31u8 {
            near(observation.target(i.into()), expected(&all[me], f64::from(i) - 30.), "observed");
        }
        for j in 0..50u8 {
            near(truth.target(j.into()), expected(&all[me], f64::from(j) + 1.), "predicted");
        }
        for slot in Slot::ALL {
            let neighbour = observation.neighbour(layout.slot(slot));
            let wanted = slots_of(me)[slot as usize];
            assert_eq!(neighbour.map_or(0, |it| it.vehicle()), wanted, "{key:?}, {slot:?}");
            if let Some(neighbour) = neighbour {
                near(neighbour.state(4).unwrap(), expected(&all[wanted as usize - 1], -26.), "neighbour");
                near(neighbour.now(), expected(&all[wanted as usize - 1], 0.), "neighbour");
            }
        }
        assert_eq!(observation.others().count(), 5);
        let [length, width] = observation.size().map(f64::from);
        assert!((length - SIZE[0]).abs() < 1e-3 && (width - SIZE[1]).abs() < 1e-3);
    }
}

/// Given lines are those of the scene, as seen from the target; `side` is -1 in the mirror image.
fn assert_lines(recording: &Recording, side: f64) {
    let (set, _) = WindowSet::cut(std::slice::from_ref(recording), &config(recording.meta().rate_hz)).unwrap();
    let observation = set.iter().next().unwrap().observation();
    let lines: Vec<_> = observation.lines().collect();
    let me = &vehicles()[0];
    let y = side * me.at(f64::from(observation.frame()) / recording.meta().rate_hz)[1];
    let mut wanted: Vec<f64> = LINES.iter().map(|line| side * line - y).collect();
    wanted.sort_by(f64::total_cmp);
    assert_eq!(lines.len(), 4);
    for (i, (line, wanted)) in lines.iter().zip(wanted).enumerate() {
        assert!((f64::from(line.y) - wanted).abs() < 6e-3, "line {i}: {} instead of {wanted}", line.y);
        assert_eq!(line.kind == MarkingKind::Boundary, i == 0 || i == 3);
    }
}

#[test]
fn both_carriageways_give_the_same_windows() {
    for layout in [Layout::Lower, Layout::Upper] {
        let recording = highd(layout, 25., None);
        assert_lines(&recording, 1.);
        assert_golden(&[recording], 25., layout);
    }
}

#[test]
fn the_target_has_the_neighbours_it_was_given() {
    assert_eq!(slots_of(0), TARGET_SLOTS);
}

#[test]
fn the_mirror_image_gives_mirrored_windows() {
    let recording = highd(Layout::LowerMirrored, 25., None);
    assert_lines(&recording, -1.);
    assert_golden(&[recording], 25., Layout::LowerMirrored);
}

#[test]
fn feet_and_front_centres_give_the_same_windows_as_metres_and_corners() {
    assert_golden(&[ngsim(None)], 10., Layout::Lower);
    assert_golden(&[highd(Layout::Lower, 10., None)], 10., Layout::Lower);
}

/// Every value but the lane lines, which for NGSIM are fitted to the whole file, to the bit.
fn reachable(observation: Observation<'_>) -> Vec<u32> {
    let state = |s: TrackState| [s.x, s.y, s.vx, s.vy].map(f32::to_bits);
    let frames = observation.shape().t_obs;
    let mut bits: Vec<u32> = (0..frames).flat_map(|i| state(observation.target(i))).collect();
    bits.extend(observation.origin().map(f32::to_bits));
    bits.extend(observation.size().map(f32::to_bits));
    bits.push(observation.lane() as u32);
    let slots = observation.neighbours();
    bits.extend(slots.values().map(|slot| slot.map_or(0, |it| it.vehicle())));
    for other in slots.0.into_iter().flatten().chain(observation.others()) {
        bits.extend(other.size().map(f32::to_bits));
        bits.extend((0..frames).flat_map(|i| other.state(i).map_or([1; 4], state)));
        let own = other.observation().unwrap();
        bits.extend((0..frames).flat_map(|i| state(own.target(i))));
    }
    bits
}

#[test]
fn rows_after_the_last_observed_frame_do_not_count() {
    let t0 = 31;
    type Maker<'a> = &'a dyn Fn(Option<u32>) -> Recording;
    let layouts: [(&str, Maker<'_>); 3] = [
        ("lower", &|scrambled| highd(Layout::Lower, 25., scrambled)),
        ("upper", &|scrambled| highd(Layout::Upper, 25., scrambled)),
        ("ngsim", &ngsim),
    ];
    for (name, make) in layouts {
        let (recorded, scrambled) = (make(None), make(Some(t0)));
        let shape = config(recorded.meta().rate_hz).shape_for(recorded.meta().rate_hz).unwrap();
        for track in 0..6 {
            let view = |recording| {
                let recording: &Recording = recording;
                let row = recording.tracks()[track].row_at(t0).unwrap();
                (Observation::new(recording, shape, track, row).unwrap(), row)
            };
            let ((a, row), (b, _)) = (view(&recorded), view(&scrambled));
            assert_eq!(reachable(a), reachable(b), "{name}, track {track}");
            let truth = Window::new(&recorded, shape, track, row).unwrap().truth();
            let after = scrambled.columns().x[row + 1] - a.origin()[0];
            assert_ne!(truth.target(0).x, after, "{name}: the scrambling reached the recording");
            let beside = |recording: &Recording| Slot::ALL.map(|slot| recording.neighbour(row + 1, slot));
            assert!(name == "ngsim" || beside(&recorded) != beside(&scrambled), "{name}: the slots are as before");
        }
    }
}
