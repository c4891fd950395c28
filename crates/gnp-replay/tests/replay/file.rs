//! A file read back with Rerun's own decoder.

use std::collections::BTreeMap;

use gnp_replay::{ARROW_M, CAN_ENCODE, VIEWER, encode};
use re_chunk::{Chunk, ComponentIdentifier, TimelineName};
use re_log_encoding::{Decoder, RawRrdManifest};
use re_log_types::{LogMsg, StoreKind};
use re_sdk_types::archetypes::{Arrows3D, Boxes3D, Clear, LineStrips3D, RecordingInfo, Scalars, SeriesLines};
use re_sdk_types::blueprint::archetypes::{TimePanelBlueprint, ViewBlueprint, ViewContents};
use re_sdk_types::blueprint::components::{AbsoluteTimeRange, QueryExpression};
use re_sdk_types::components::{
    ClearIsRecursive, Color, EntityPath, HalfSize3D, LineStrip3D, Name, Position3D, Scalar, Text, Translation3D,
    Vector3D,
};
use re_sdk_types::datatypes::Vec3D;
use re_sdk_types::{Component, ComponentDescriptor};

use crate::clip::{PICKED, clip};

/// What a file holds.
struct Held {
    /// Versions, applications and names of the stores, the recording first.
    stores: Vec<(String, String, String)>,
    recording: Vec<Chunk>,
    layout: Vec<Chunk>,
    activated: bool,
}

fn read(bytes: &[u8]) -> Held {
    let mut held = Held { stores: Vec::new(), recording: Vec::new(), layout: Vec::new(), activated: false };
    for message in Decoder::<LogMsg>::decode_eager(bytes).unwrap() {
        match message.unwrap() {
            LogMsg::SetStoreInfo(store) => {
                let version = store.info.store_version.unwrap().to_string();
                let (application, name) = (store.info.application_id(), store.info.recording_id());
                held.stores.push((version, application.to_string(), name.to_string()));
            }
            LogMsg::ArrowMsg(store, message) => {
                let chunk = Chunk::from_arrow_msg(&message).unwrap();
                match store.kind() {
                    StoreKind::Recording => held.recording.push(chunk),
                    StoreKind::Blueprint => held.layout.push(chunk),
                }
            }
            LogMsg::BlueprintActivationCommand(command) => held.activated = command.make_active && command.make_default,
        }
    }
    held
}

/// The rows of a component of an entity by time in ns, or 0 where it is static.
fn column<C: Component>(chunks: &[Chunk], entity: &str, component: &ComponentDescriptor) -> BTreeMap<i64, Vec<C>> {
    let id: ComponentIdentifier = component.component;
    let mut rows = BTreeMap::new();
    for chunk in chunks.iter().filter(|chunk| chunk.entity_path().to_string() == entity) {
        let times = chunk.timelines().get(&TimelineName::from("time")).map(|column| column.times_raw().to_vec());
        for row in 0..chunk.num_rows() {
            if let Some(values) = chunk.component_batch::<C>(id, row) {
                rows.insert(times.as_ref().map_or(0, |times| times[row]), values.unwrap());
            }
        }
    }
    rows
}

/// The time of a frame, ns.
fn at(frame: i64) -> i64 {
    frame * 40_000_000
}

#[test]
fn a_file_names_its_version_and_its_stores() {
    const { assert!(CAN_ENCODE) };
    let bytes = encode(&clip(), PICKED).unwrap();
    assert_eq!(&bytes[..4], b"RRF2");
    let held = read(&bytes);
    let [recording, layout] = &held.stores[..] else { panic!("{:?}", held.stores) };
    assert_eq!((recording.0.as_str(), recording.1.as_str(), layout.1.as_str()), (VIEWER, "gnp", "gnp"));
    assert_ne!(recording.2, layout.2);
    // Both are in the table of contents only where they can be listed in one order: the recording.
    let contents = RawRrdManifest::from_rrd_bytes(&bytes).unwrap();
    assert_eq!(contents.len(), 1);
    assert_eq!(contents[0].store_id.recording_id().to_string(), recording.2);
    assert_eq!(contents[0].data.num_rows(), held.recording.len());
    let name = column::<Name>(&held.recording, "/__properties", &RecordingInfo::descriptor_name());
    assert_eq!(name[&0], [Name::from("us101-13, US-101")]);
}

#[test]
fn the_same_clip_gives_the_same_bytes_and_another_one_another_name() {
    let bytes = encode(&clip(), PICKED).unwrap();
    assert!(bytes == encode(&clip(), PICKED).unwrap());
    let mut other = clip();
    other.vehicles[1].states[2].centre[0] += 0.01;
    assert_ne!(read(&bytes).stores, read(&encode(&other, PICKED).unwrap()).stores);
}

#[test]
fn every_record_is_there_on_both_timelines() {
    let held = read(&encode(&clip(), PICKED).unwrap());
    let mut expected: BTreeMap<String, usize> = BTreeMap::new();
    for record in gnp_replay::records(&clip(), PICKED) {
        expected.insert(record.entity, record.rows.len());
    }
    expected.extend([("/".to_owned(), 1), ("/__properties".to_owned(), 1)]);
    let mut found: BTreeMap<String, usize> = BTreeMap::new();
    for chunk in &held.recording {
        *found.entry(chunk.entity_path().to_string()).or_default() += chunk.num_rows();
        if !chunk.is_static() {
            let raw = |name| chunk.timelines()[&TimelineName::from(name)].times_raw().to_vec();
            let (times, frames) = (raw("time"), raw("frame"));
            assert_eq!(chunk.timelines().len(), 2);
            assert_eq!(times, frames.iter().map(|frame| at(*frame)).collect::<Vec<_>>());
            assert!(frames.is_sorted() && frames.iter().all(|frame| (100..=130).contains(frame)), "{frames:?}");
        }
    }
    assert_eq!(found, expected);
}

#[test]
fn boxes_paths_and_forces_stand_where_the_clip_has_them() {
    let held = read(&encode(&clip(), PICKED).unwrap());
    let near = |found: Vec3D, x: f32, y: f32| {
        let found = found.0;
        assert!(
            (found[0] - x).abs() < 1e-4 && (found[1] - y).abs() < 1e-4 && found[2] == 0.,
            "{found:?}, not {x}, {y}"
        );
    };
    let centres = column::<Translation3D>(&held.recording, "/vehicles/31", &Boxes3D::descriptor_centers());
    assert_eq!(centres.keys().copied().collect::<Vec<_>>(), [100, 105, 110, 115].map(at));
    near(centres[&at(110)][0].0, 42.4, 3.5);
    let halves = column::<HalfSize3D>(&held.recording, "/vehicles/31", &Boxes3D::descriptor_half_sizes());
    near(halves[&at(100)][0].0, 6., 1.25);
    let gone = column::<ClearIsRecursive>(&held.recording, "/vehicles/31", &Clear::descriptor_is_recursive());
    assert_eq!(gone.keys().copied().collect::<Vec<_>>(), [at(120)]);

    let (futures, goal) = ("/forecasts/7/futures", "/forecasts/7/forces/goal");
    let paths = column::<LineStrip3D>(&held.recording, futures, &LineStrips3D::descriptor_strips());
    assert_eq!(paths[&at(120)].len(), 3);
    let [start, middle, end] = &paths[&at(120)][0].0[..] else { panic!("{paths:?}") };
    near(*start, 16.4, 0.6);
    near(*middle, 19.4, 0.9);
    near(*end, 22.4, 1.2);
    let labels = column::<Text>(&held.recording, futures, &LineStrips3D::descriptor_labels());
    assert_eq!(labels[&at(100)][1], Text::from("30 %"));
    let colours = column::<Color>(&held.recording, futures, &LineStrips3D::descriptor_colors());
    assert_eq!(colours[&at(100)][0].to_array(), [0x8b, 0, 0, 255]);

    let vectors = column::<Vector3D>(&held.recording, goal, &Arrows3D::descriptor_vectors());
    near(vectors[&at(100)][1].0, 4. * ARROW_M, 0.25 * ARROW_M);
    let origins = column::<Position3D>(&held.recording, goal, &Arrows3D::descriptor_origins());
    near(origins[&at(100)][1].0, 13., 0.5);
}

#[test]
fn scalars_have_names_and_values() {
    let held = read(&encode(&clip(), PICKED).unwrap());
    let tau = column::<Scalar>(&held.recording, "/scalars/7/goal/tau", &Scalars::descriptor_scalars());
    assert_eq!(tau.len(), 7);
    assert!((tau[&at(115)][0].0.0 - 0.8).abs() < 1e-6, "{tau:?}");
    let k = column::<Scalar>(&held.recording, "/scalars/7/neighbours/k", &Scalars::descriptor_scalars());
    assert_eq!(k[&at(105)][7], Scalar::from(71.));
    let names = column::<Name>(&held.recording, "/scalars/7/neighbours/k", &SeriesLines::descriptor_names());
    assert_eq!((names[&0].len(), &names[&0][4]), (8, &Name::from("left behind")));
}

#[test]
fn the_layout_is_active_and_shows_the_picked_vehicle() {
    let held = read(&encode(&clip(), PICKED).unwrap());
    assert!(held.activated);
    let mut origins = Vec::new();
    let mut contents = Vec::new();
    for chunk in &held.layout {
        let batch = |id| chunk.component_batch::<EntityPath>(id, 0).map(|values| values.unwrap()[0].to_string());
        origins.extend(batch(ViewBlueprint::descriptor_space_origin().component));
        let queries = chunk.component_batch::<QueryExpression>(ViewContents::descriptor_query().component, 0);
        contents.extend(queries.into_iter().flat_map(|queries| queries.unwrap()).map(|query| query.0.to_string()));
    }
    for part in ["speed", "goal/tau", "neighbours/k", "lines/k", "probability"] {
        assert!(origins.contains(&format!("/scalars/7/{part}")), "{origins:?}");
    }
    assert!(contents.contains(&"+ /forecasts/7/**".to_owned()), "{contents:?}");

    let panel = held.layout.iter().find(|chunk| chunk.entity_path().to_string() == "/time_panel").unwrap();
    let selected = TimePanelBlueprint::descriptor_time_selection().component;
    let [range] = &panel.component_batch::<AbsoluteTimeRange>(selected, 0).unwrap().unwrap()[..] else { panic!() };
    assert_eq!((range.0.min.0, range.0.max.0), (at(100), at(130)));

    // With nobody picked there is a road and a text.
    let chunks = read(&encode(&clip(), None).unwrap()).layout;
    let views = chunks.iter().filter(|chunk| chunk.entity_path().to_string().ends_with("/ViewContents")).count();
    assert_eq!(views, 2);
}
