//! Boxes that overlap.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::traffic::Traffic;

/// Boxes that overlap by less than this touch at most, m: positions are in single precision.
const TOUCH: f64 = 1e-3;

/// Two vehicles whose boxes overlap, from the first such frame to the last without a pause.
///
/// In a simulation that is a collision. In recordings from cameras it is an error of the boxes more often than not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Contact {
    /// The vehicle behind and the one ahead in the first frame.
    pub vehicles: [u32; 2],
    /// Index of the carriageway.
    pub road: u16,
    /// Place of the one behind in the first frame, m.
    pub x: f64,
    /// First and last frame, s.
    pub t: [f64; 2],
    /// Frames in which they overlap.
    pub frames: u32,
    /// The most that one of the two would have to move, along the road or across it, m.
    pub depth: f64,
}

/// A vehicle in a frame.
struct Body {
    road: u16,
    /// Place of its rear, m.
    rear: f64,
    length: f64,
    y: [f64; 2],
    track: u32,
    x: f64,
}

/// Contacts of a recording, by time.
pub(crate) fn contacts(traffic: &Traffic<'_>) -> Vec<Contact> {
    let tracks = traffic.recording().tracks();
    let y = &traffic.recording().columns().y;
    let mut done = Vec::new();
    let mut open: BTreeMap<[u32; 2], (Contact, u32)> = BTreeMap::new();
    let mut bodies: Vec<Body> = Vec::new();
    for frame in traffic.frames() {
        bodies.clear();
        for index in traffic.recording().present(frame) {
            let track = &tracks[*index as usize];
            let Some(row) = track.row_at(frame) else { continue };
            let (length, half) = (f64::from(track.length), f64::from(track.width) / 2.);
            let (x, at) = (traffic.x(row), f64::from(y[row]));
            let rear = traffic.place(x - length / 2.);
            bodies.push(Body { road: track.road, rear, length, y: [at - half, at + half], track: *index, x });
        }
        bodies.sort_unstable_by(|a, b| a.road.cmp(&b.road).then(a.rear.total_cmp(&b.rear)).then(a.track.cmp(&b.track)));
        for road in bodies.chunk_by(|a, b| a.road == b.road) {
            for (behind, ahead, depth) in overlapping(road, traffic.circumference()) {
                let pair = [behind.track.min(ahead.track), behind.track.max(ahead.track)];
                let time = traffic.time_s(frame);
                let new = || Contact {
                    vehicles: [behind, ahead].map(|body| tracks[body.track as usize].vehicle),
                    road: behind.road,
                    x: traffic.place(behind.x),
                    t: [time, time],
                    frames: 0,
                    depth: 0.,
                };
                let (contact, last) = open.entry(pair).or_insert_with(|| (new(), frame));
                (contact.t[1], *last) = (time, frame);
                contact.frames += 1;
                contact.depth = contact.depth.max(depth);
            }
        }
        open.retain(|_, (contact, last)| {
            if *last < frame {
                done.push(*contact);
            }
            *last >= frame
        });
    }
    done.extend(open.into_values().map(|(contact, _)| contact));
    done.sort_by(|a, b| a.t[0].total_cmp(&b.t[0]).then(a.vehicles.cmp(&b.vehicles)));
    done
}

/// Pairs of one carriageway, sorted by their rears, that overlap, with the depth, m.
fn overlapping(bodies: &[Body], around: Option<f64>) -> Vec<(&Body, &Body, f64)> {
    let mut pairs = Vec::new();
    let n = bodies.len();
    for (i, behind) in bodies.iter().enumerate() {
        // On a ring the search goes on over the seam.
        let seam = around.map(|around| bodies[..i].iter().map(move |body| (body, body.rear + around)));
        let ahead = bodies[i + 1..n].iter().map(|body| (body, body.rear));
        for (ahead, rear) in ahead.chain(seam.into_iter().flatten()) {
            let along = behind.rear + behind.length - rear;
            if along <= TOUCH {
                break;
            }
            let across = behind.y[1].min(ahead.y[1]) - behind.y[0].max(ahead.y[0]);
            if across > TOUCH {
                pairs.push((behind, ahead, along.min(across)));
            }
        }
    }
    pairs
}
