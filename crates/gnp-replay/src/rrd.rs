//! Records as Rerun's chunks, and chunks as the bytes of an `.rrd` file.
//!
//! Rerun's own stream of log calls gives every row the time of the call and a random name. Here names
//! count up from one, so that the same clip gives the same bytes.

use std::io::Write as _;

use gnp_plot::Clip;
use re_chunk::{Chunk, ChunkId, EntityPath, RowId, TimePoint};
use re_log_types::{
    BlueprintActivationCommand, LogMsg, SetStoreInfo, StoreId, StoreInfo, StoreKind, StoreSource, TimeCell,
};
use re_sdk_types::archetypes::{
    Arrows3D, Boxes3D, Clear, LineStrips3D, RecordingInfo, Scalars, SeriesLines, TextDocument, ViewCoordinates,
};
use re_sdk_types::components::{Color, FillMode, MediaType, Radius};
use re_sdk_types::external::re_types_core::external::re_tuid::Tuid;
use re_sdk_types::{AsComponents, datatypes::Rgba32};
use sha2::{Digest as _, Sha256};

use crate::colour::Colour;
use crate::error::ReplayError;
use crate::file::{File, packed};
use crate::layout;
use crate::record::{Drawing, Record, Row};
use crate::records::records;

/// Name under which the viewer keeps files of this program, and its layout of them.
const APPLICATION: &str = "gnp";

pub(crate) fn encode(clip: &Clip, picked: Option<u32>) -> Result<Vec<u8>, ReplayError> {
    let records = records(clip, picked);
    // Two files of one name would be taken for parts of one recording.
    let name = digest(clip, &records)?;
    let mut chunks = Chunks::default();
    chunks.always("/", &ViewCoordinates::RIGHT_HAND_Z_UP())?;
    chunks.always(EntityPath::properties(), &RecordingInfo::new().with_name(clip.heading()))?;
    for record in &records {
        let (fixed, moving): (Vec<&Row>, Vec<&Row>) = record.rows.iter().partition(|row| row.frame.is_none());
        for rows in [fixed, moving] {
            let row = |row: &Row| (time(row.frame, clip.rate_hz), archetype(&row.drawing));
            chunks.add(record.entity.as_str(), rows.into_iter().map(row))?;
        }
    }
    let recording = StoreId::new(StoreKind::Recording, APPLICATION, name.clone());
    let blueprint = StoreId::new(StoreKind::Blueprint, APPLICATION, format!("layout-{name}"));

    let mut file = File::new()?;
    file.message(&introduction(&recording))?;
    file.message(&introduction(&blueprint))?;
    for chunk in layout::chunks(clip, picked)?.0 {
        file.message(&packed(&blueprint, &chunk)?)?;
    }
    file.message(&LogMsg::BlueprintActivationCommand(BlueprintActivationCommand {
        blueprint_id: blueprint,
        make_active: true,
        make_default: true,
    }))?;
    for chunk in &chunks.0 {
        file.recorded(&recording, chunk)?;
    }
    file.finish(&recording)
}

/// Chunks, with names that count up.
#[derive(Default)]
pub(crate) struct Chunks(Vec<Chunk>);

impl Chunks {
    /// Rows of one entity; none make no chunk.
    pub(crate) fn add(
        &mut self,
        entity: impl Into<EntityPath>,
        rows: impl IntoIterator<Item = (TimePoint, Box<dyn AsComponents>)>,
    ) -> Result<(), ReplayError> {
        let number = self.0.len() as u64 + 1;
        let entity = entity.into();
        let mut builder =
            Chunk::builder_with_id(ChunkId::from_tuid(Tuid::from_nanos_and_inc(number, 0)), entity.clone());
        let mut row = RowId::from_tuid(Tuid::from_nanos_and_inc(number, 0));
        let mut any = false;
        for (time, components) in rows {
            row = row.next();
            any = true;
            builder = builder.with_archetype(row, time, &*components);
        }
        if any {
            let refused = |error| ReplayError::Entity { entity: entity.to_string(), source: Box::new(error) };
            self.0.push(builder.build().map_err(refused)?);
        }
        Ok(())
    }

    /// What an entity always shows.
    fn always(
        &mut self,
        entity: impl Into<EntityPath>,
        components: &(impl AsComponents + Clone + 'static),
    ) -> Result<(), ReplayError> {
        self.add(entity, [(TimePoint::default(), Box::new(components.clone()) as Box<dyn AsComponents>)])
    }
}

fn time(frame: Option<u32>, rate_hz: f64) -> TimePoint {
    let Some(frame) = frame else { return TimePoint::default() };
    TimePoint::default()
        .with_index("time", TimeCell::from_duration_nanos(nanoseconds(frame, rate_hz)))
        .with_index("frame", TimeCell::from_sequence(i64::from(frame)))
}

/// Time of a frame since frame 0, ns.
pub(crate) fn nanoseconds(frame: u32, rate_hz: f64) -> i64 {
    (f64::from(frame) / rate_hz * 1e9).round() as i64
}

fn archetype(drawing: &Drawing) -> Box<dyn AsComponents> {
    match drawing {
        Drawing::Box { centre, size, colour, label } => Box::new(
            Boxes3D::from_centers_and_sizes([flat(*centre)], [flat(*size)])
                .with_colors([color(*colour)])
                .with_fill_mode(FillMode::TransparentFillMajorWireframe)
                .with_labels([label.as_str()])
                .with_show_labels(false),
        ),
        Drawing::Strips { strips, colours, radius, labels } => {
            let strips = LineStrips3D::new(strips.iter().map(|points| points.iter().copied().map(flat)))
                .with_colors(colours.iter().copied().map(color))
                .with_radii([Radius::new_ui_points(*radius)]);
            if labels.is_empty() {
                return Box::new(strips);
            }
            Box::new(strips.with_labels(labels.iter().map(String::as_str)).with_show_labels(false))
        }
        Drawing::Arrows { origins, vectors, colour } => Box::new(
            Arrows3D::from_vectors(vectors.iter().copied().map(flat))
                .with_origins(origins.iter().copied().map(flat))
                .with_colors([color(*colour)])
                .with_radii([Radius::new_ui_points(2.)]),
        ),
        Drawing::Scalars(values) => Box::new(Scalars::new(values.iter().copied().map(f64::from))),
        Drawing::Series(names) => Box::new(SeriesLines::new().with_names(names.iter().map(String::as_str))),
        Drawing::Text(text) => Box::new(TextDocument::new(text.as_str()).with_media_type(MediaType::markdown())),
        Drawing::Gone => Box::new(Clear::recursive()),
    }
}

/// On the road.
fn flat([x, y]: [f32; 2]) -> [f32; 3] {
    [x, y, 0.]
}

pub(crate) fn color(Colour([r, g, b, a]): Colour) -> Color {
    Color::from(Rgba32::from_unmultiplied_rgba(r, g, b, a))
}

fn introduction(store: &StoreId) -> LogMsg {
    let source = StoreSource::Other(format!("gnp-replay {}", env!("CARGO_PKG_VERSION")));
    LogMsg::SetStoreInfo(SetStoreInfo { row_id: Tuid::ZERO, info: StoreInfo::new(store.clone(), source) })
}

/// A name that differs where the content does.
fn digest(clip: &Clip, records: &[Record]) -> Result<String, ReplayError> {
    let mut hash = Sha256::new();
    // A float is printed so that it can be read back exactly.
    write!(hash, "{} {} {records:?}", clip.title, clip.rate_hz).map_err(|error| ReplayError::File(Box::new(error)))?;
    Ok(hash.finalize()[..8].iter().map(|byte| format!("{byte:02x}")).collect())
}
