//! From placed rows to a recording.

use std::collections::{BTreeMap, BTreeSet};

use super::bodies::{class_of, default_size};
use super::layout::TrackLayout;
use super::road::Placed;
use super::{TableVehicle, TrackTable, units};
use crate::assemble::{Rows, VehicleBody};
use crate::error::{DataError, TrackProblem};
use crate::formats::findings::Tally;
use crate::formats::motion::Motion;
use crate::ingest_report::{IngestReport, LaneSource};
use crate::recording::{Recording, RecordingMeta, Road};

/// Speed from which on the ratio of two speeds tells a unit, m/s.
const TELLING: f32 = 2.;

impl TrackLayout {
    /// The recording of a table laid out like the one in which this was found, and a report on it. Vehicles have the
    /// numbers of their names there; those that had none there are left out, where names are no numbers.
    ///
    /// # Errors
    /// As [`TrackTable::recordings`], for values, times and units.
    pub fn recording(&self, table: &TrackTable) -> Result<(Recording, IngestReport), DataError> {
        self.build(table, self.place(table)?)
    }

    /// The recording of placed rows.
    pub(super) fn build(&self, table: &TrackTable, mut placed: Placed) -> Result<(Recording, IngestReport), DataError> {
        let class = |vehicle: &TableVehicle| vehicle.class.unwrap_or_else(|| class_of(vehicle.length));
        let size = |vehicle: &TableVehicle| {
            let [length, width] = default_size(class(vehicle));
            [vehicle.length.unwrap_or(length), vehicle.width.unwrap_or(width)]
        };
        units::sizes(table)?;
        for vehicle in units::odd_sizes(table, size)? {
            placed.left_out.insert(vehicle, "are of no size a vehicle has (0.5 to 40 m by 0.3 to 5 m)".to_owned());
        }
        for vehicle in self.wrong_velocities(table, &placed)? {
            placed.left_out.insert(vehicle, "have another speed than their positions".to_owned());
        }
        for (vehicle, _) in &placed.taken.spans {
            if self.numbering.number(&table.vehicles[*vehicle as usize].name).is_none() {
                let why = "have names that were not there when vehicles were numbered";
                placed.left_out.entry(*vehicle).or_insert_with(|| why.to_owned());
            }
        }

        let mut kept: Vec<(usize, u32, u16)> = Vec::new();
        for ((vehicle, span), way) in placed.taken.spans.iter().zip(&placed.way) {
            let number = self.numbering.number(&table.vehicles[*vehicle as usize].name);
            if let (Some(way), Some(number), false) = (way, number, placed.left_out.contains_key(vehicle)) {
                kept.extend(span.clone().filter(|i| placed.s[*i].is_finite()).map(|i| (i, number, *way)));
            }
        }
        if kept.is_empty() {
            let what = "no vehicle is left that can be believed".to_owned();
            return Err(table.wrong(TrackProblem::Empty, None, None, what, "repair the tracks"));
        }
        let pick = |values: &[f64]| -> Vec<f32> { kept.iter().map(|(i, ..)| values[*i] as f32).collect() };
        let frame = kept.iter().map(|(i, ..)| placed.taken.frame[*i]).collect();
        let vehicle = kept.iter().map(|(_, number, _)| *number).collect();
        let mut rows = Rows::new(vehicle, frame, pick(&placed.s), pick(&placed.d));
        rows.velocity = placed.rates.as_ref().map(|[along, across]| [pick(along), pick(across)]);
        let number = |i: usize| table.lane.as_ref().map(|lane| lane[placed.taken.row(i)]);
        let lane_at = |(i, _, way): &(usize, u32, u16)| {
            self.ways.0[usize::from(*way)].lanes.lane(placed.d[*i] as f32, number(*i))
        };
        rows.lane = kept.iter().map(lane_at).collect();
        let body = |row: usize| {
            let (i, _, road) = kept[row];
            let vehicle = &table.vehicles[table.vehicle[placed.taken.row(i)] as usize];
            let [length, width] = size(vehicle);
            VehicleBody { class: class(vehicle), length, width, road }
        };
        let meta = RecordingMeta::new(table.dataset, &table.site, &table.name, self.clock.rate_hz())
            .with_simulated(table.simulated)
            .with_start(self.clock.start_s());
        let (recording, mut report) = Recording::from_rows(meta, self.roads(), rows, body)?;
        self.report(table, &placed, &mut report);
        let recording = if self.numbering.is_by_order() {
            let names = kept.iter().map(|(i, number, _)| {
                (*number, table.vehicles[table.vehicle[placed.taken.row(*i)] as usize].name.clone())
            });
            recording.with_vehicle_names(names.collect())
        } else {
            recording
        };
        Ok((recording, report))
    }

    fn roads(&self) -> Vec<Road> {
        let road = |way: &super::road::Way| Road {
            driving_direction: if way.along { 2 } else { 1 },
            lines: way.lanes.lines.clone(),
            fitted: !way.lanes.given,
            axis: Some(if way.along { self.axis.clone() } else { self.axis.reversed() }),
        };
        self.ways.0.iter().map(road).collect()
    }

    /// Vehicles whose velocities are not those of their positions.
    fn wrong_velocities(&self, table: &TrackTable, placed: &Placed) -> Result<Vec<u32>, DataError> {
        let Some([along, _]) = &placed.rates else { return Ok(Vec::new()) };
        let single = |values: &[f64]| -> Vec<f32> {
            values.iter().map(|v| if v.is_finite() { *v as f32 } else { 0. }).collect()
        };
        let (s, d, stated) = (single(&placed.s), single(&placed.d), single(along));
        let motion = Motion { frame: &placed.taken.frame, x: &s, y: &d, rate_hz: self.clock.rate_hz() };
        let (mut found, mut tally, mut ratios) = (Vec::new(), Tally::default(), Vec::new());
        let judged = placed.taken.spans.iter().zip(&placed.way).filter(|(_, way)| way.is_some());
        let mut count = 0;
        for ((vehicle, span), _) in judged {
            count += 1;
            if !motion.contradicts(span.clone(), &stated) {
                continue;
            }
            found.push(*vehicle);
            tally.add(placed.taken.row(span.start));
            let rate_hz = self.clock.rate_hz() as f32;
            let steps = placed.taken.steps(span).map(|i| (stated[i].abs(), (s[i] - s[i - 1]).abs() * rate_hz));
            ratios.extend(steps.filter(|(_, speed)| *speed > TELLING).map(|(stated, speed)| stated / speed));
        }
        units::velocities(table, tally, count, &mut ratios)?;
        Ok(found)
    }

    /// Says what was left out, found and assumed.
    fn report(&self, table: &TrackTable, placed: &Placed, report: &mut IngestReport) {
        report.rows_read = table.len() as u64;
        report.out_of_order = placed.taken.out_of_order;
        let unread = table.vehicles.iter().zip(0..).filter_map(|(vehicle, i)| Some((i, vehicle.left_out.clone()?)));
        let left_out: BTreeMap<u32, String> = unread.chain(placed.left_out.clone()).collect();
        for reason in left_out.values() {
            *report.vehicles_left_out.entry(reason.clone()).or_insert(0) += 1;
        }
        report.skipped_rows = table.skipped_rows.clone();
        for (reason, rows) in [
            ("they are between the frames of the rate asked for", placed.taken.between),
            ("they are off the road's line", placed.off_line),
        ] {
            if rows > 0 {
                report.skipped_rows.insert(reason.to_owned(), rows);
            }
        }
        report.rows_read += table.skipped_rows.values().sum::<u64>();
        if self.ways.0.iter().all(|way| way.lanes.given) {
            report.lanes = LaneSource::Given;
        }
        let mut notes = Vec::new();
        if self.straight {
            let heading = self.axis.at(0., 0.).heading.to_degrees();
            notes.push(format!("the road is taken for straight, at {heading:.1} degrees to the x axis of the tracks"));
        }
        match &self.ways.0[..] {
            [way] => notes.push(format!("lanes: {}", way.lanes.note)),
            ways => notes.extend(ways.iter().map(|way| {
                let side = if way.along { "along the road" } else { "against it" };
                format!("lanes {side}: {}", way.lanes.note)
            })),
        }
        let read: BTreeSet<u32> = placed.taken.spans.iter().map(|(vehicle, _)| *vehicle).collect();
        let read: Vec<&TableVehicle> = read
            .iter()
            .filter(|vehicle| !left_out.contains_key(vehicle))
            .map(|i| &table.vehicles[*i as usize])
            .collect();
        for (without, what) in [
            (read.iter().filter(|it| it.length.is_none()).count(), "no length: that of their class is taken"),
            (read.iter().filter(|it| it.width.is_none()).count(), "no width: that of their class is taken"),
            (
                read.iter().filter(|it| it.class.is_none()).count(),
                "no class: told from the length, a car where unknown",
            ),
        ] {
            if without > 0 {
                notes.push(format!("{without} of {} vehicles have {what}", read.len()));
            }
        }
        if self.numbering.is_by_order() {
            notes.push("vehicles are numbered in the order of appearance; their names are kept".to_owned());
        }
        if placed.rates.is_none() && (table.velocity.is_some() || table.speed.is_some()) {
            notes.push("speeds are not taken, because some are unknown or without a heading".to_owned());
        }
        notes.extend(table.notes.iter().cloned());
        report.notes.extend(notes);
    }
}
