//! A vehicle of floating car data, and what its type says of it.

use std::collections::BTreeMap;
use std::path::Path;

use super::xml::Elements;
use crate::error::DataError;
use crate::recording::VehicleClass;

/// A vehicle at a moment, as the file has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Vehicle<'a> {
    /// Line of the file, or row.
    pub(super) place: u64,
    /// s.
    pub(super) time_s: f64,
    pub(super) id: &'a str,
    /// Middle of the front bumper, m.
    pub(super) front: [f64; 2],
    /// Degrees clockwise from north, the direction of y.
    pub(super) angle: f64,
    /// m/s.
    pub(super) speed: Option<f64>,
    /// Name of its type.
    pub(super) kind: &'a str,
    /// `EDGE_INDEX`, 0 the rightmost; empty where the file has none.
    pub(super) lane: &'a str,
}

impl Vehicle<'_> {
    /// Direction of travel, rad anticlockwise from x.
    pub(super) fn heading(&self) -> f64 {
        (90. - self.angle).to_radians()
    }

    /// Edge and index of the lane; none within a junction, whose lanes continue no others.
    pub(super) fn edge(&self) -> Option<(&str, i16)> {
        let (edge, index) = self.lane.rsplit_once('_')?;
        let index = index.parse().ok().filter(|index| (0..1000).contains(index))?;
        (!edge.starts_with(':')).then_some((edge, index))
    }
}

/// What else a file of floating car data has.
#[derive(Clone, Debug, Default)]
pub(super) struct Other {
    /// Rows of persons and containers.
    pub(super) persons: u64,
}

/// What a type is: class, length and width in m; `None` for what does not drive on motorways.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Kind {
    pub(super) class: Option<VehicleClass>,
    pub(super) size: [f32; 2],
    /// Whether a file says so, instead of the name of the type.
    pub(super) stated: bool,
}

/// SUMO's classes with the length and width in m that vehicles have there unless their type says otherwise. In this order:
/// a type that no file describes is taken for the first class whose name is in its own.
const CLASSES: [(&str, VehicleClass, [f32; 2]); 18] = [
    ("motorcycle", VehicleClass::Motorcycle, [2.2, 0.9]),
    ("motorbike", VehicleClass::Motorcycle, [2.2, 0.9]),
    ("moped", VehicleClass::Motorcycle, [2.1, 0.8]),
    ("trailer", VehicleClass::Truck, [16.5, 2.55]),
    ("semi", VehicleClass::Truck, [16.5, 2.55]),
    ("coach", VehicleClass::Truck, [14., 2.6]),
    ("bus", VehicleClass::Truck, [12., 2.5]),
    ("truck", VehicleClass::Truck, [7.1, 2.4]),
    ("lorry", VehicleClass::Truck, [7.1, 2.4]),
    ("hgv", VehicleClass::Truck, [7.1, 2.4]),
    ("hdv", VehicleClass::Truck, [7.1, 2.4]),
    ("heavy", VehicleClass::Truck, [7.1, 2.4]),
    ("delivery", VehicleClass::Car, [6.5, 2.16]),
    ("emergency", VehicleClass::Car, [6.5, 2.16]),
    ("authority", VehicleClass::Car, [5., 1.8]),
    ("passenger", VehicleClass::Car, [5., 1.8]),
    ("private", VehicleClass::Car, [5., 1.8]),
    ("car", VehicleClass::Car, [5., 1.8]),
];

/// Words of types and classes that do not drive on motorways, each between what is no letter.
const OTHERS: [&str; 10] =
    ["bicycle", "bike", "biketype", "pedestrian", "pedtype", "rail", "railtype", "tram", "ship", "subway"];

/// What SUMO takes a vehicle for whose type says nothing.
const PASSENGER: (VehicleClass, [f32; 2]) = (VehicleClass::Car, [5., 1.8]);

/// The types of vehicles that files describe.
#[derive(Clone, Debug, Default)]
pub(super) struct Types(BTreeMap<String, Kind>);

impl Types {
    /// Adds the types of a route file or an additional file.
    ///
    /// # Errors
    /// When the file cannot be read, is no XML, or a size is no number.
    pub(super) fn read(&mut self, file: &Path) -> Result<(), DataError> {
        Elements::open(file)?.each(|element| {
            if element.is("vType") {
                let [id, class, length, width] = element.attributes(["id", "vClass", "length", "width"])?;
                let (class, [usual_length, usual_width]) = by_name(class.as_deref().unwrap_or("passenger"));
                let size = |name: &str, text: Option<String>, usual: f32| {
                    text.map_or(Ok(usual), |text| element.number(name, &text).map(|value| value as f32))
                };
                let size = [size("length", length, usual_length)?, size("width", width, usual_width)?];
                let id = id.ok_or_else(|| element.bad("id", "", "is missing from a vType"))?;
                self.0.insert(id, Kind { class, size, stated: true });
            }
            Ok(true)
        })
    }

    /// What a type is, as a file says or as its name does.
    pub(super) fn kind(&self, name: &str) -> Kind {
        self.0.get(name).copied().unwrap_or_else(|| {
            let (class, size) = by_name(name);
            Kind { class, size, stated: false }
        })
    }
}

fn by_name(name: &str) -> (Option<VehicleClass>, [f32; 2]) {
    let name = name.to_ascii_lowercase();
    let other = name.split(|c: char| !c.is_ascii_alphabetic()).any(|word| OTHERS.contains(&word));
    let known = CLASSES.iter().find(|(word, ..)| name.contains(word));
    let (class, size) = known.map_or(PASSENGER, |(_, class, size)| (*class, *size));
    ((!other).then_some(class), size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lane_is_an_edge_and_an_index() {
        let edge = |lane: &'static str| {
            let it = Vehicle { place: 1, time_s: 0., id: "a", front: [0.; 2], angle: 90., speed: None, kind: "", lane };
            it.edge().map(|(edge, index)| (edge.to_owned(), index))
        };
        assert_eq!(edge("a_b_2"), Some(("a_b".to_owned(), 2)));
        assert_eq!(edge(":J1_0_0"), None);
        assert_eq!(edge(""), None);
        assert_eq!(edge("a_-1"), None);
    }

    #[test]
    fn a_type_is_what_a_file_says_or_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("types.add.xml");
        let text = "<additional><vTypeDistribution id=\"mix\">\n<vType id=\"A&amp;B\" vClass=\"truck\" length=\"12.5\"/>\
                    </vTypeDistribution><vType id=\"c\"><param key=\"a\" value=\"b\"/></vType></additional>";
        std::fs::write(&file, text).unwrap();
        let mut types = Types::default();
        types.read(&file).unwrap();
        let kind = |name: &str| {
            let it = types.kind(name);
            (it.class, it.size, it.stated)
        };
        assert_eq!(kind("A&B"), (Some(VehicleClass::Truck), [12.5, 2.4], true));
        assert_eq!(kind("c"), (Some(VehicleClass::Car), [5., 1.8], true));
        assert_eq!(kind("DEFAULT_VEHTYPE"), (Some(VehicleClass::Car), [5., 1.8], false));
        assert_eq!(kind("Motorbike1"), (Some(VehicleClass::Motorcycle), [2.2, 0.9], false));
        for other in ["fast_bicycle", "DEFAULT_BIKETYPE", "rail_urban", "tram"] {
            assert_eq!(kind(other).0, None, "{other}");
        }
        assert_eq!(kind("trailer").0, Some(VehicleClass::Truck));
        std::fs::write(&file, "<additional>\n<vType id=\"a\" length=\"x\"/></additional>").unwrap();
        let error = Types::default().read(&file).unwrap_err().to_string();
        assert!(error.contains("line 2") && error.contains("`length`"), "{error}");
    }
}
