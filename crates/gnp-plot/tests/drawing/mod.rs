//! Reading a drawing back: elements with their attributes and the classes around them.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // only tests call these

use std::collections::BTreeMap;

use resvg::usvg::{Group, Node, Options, Tree};

/// An element of an SVG document.
#[derive(Clone, Debug)]
pub(crate) struct Element {
    /// Tag, such as `line`.
    pub(crate) name: String,
    /// Attributes.
    pub(crate) attributes: BTreeMap<String, String>,
    /// Own class and those of the groups around it, outermost first.
    pub(crate) classes: Vec<String>,
    /// Text inside.
    pub(crate) text: String,
}

impl Element {
    /// A numeric attribute.
    pub(crate) fn number(&self, key: &str) -> f64 {
        self.attributes[key].parse().unwrap_or_else(|_| panic!("{key} of {self:?}"))
    }

    /// Whether it or a group around it has the class.
    pub(crate) fn is(&self, class: &str) -> bool {
        self.classes.iter().any(|c| c.split(' ').any(|c| c == class))
    }

    /// Centre of a rectangle.
    pub(crate) fn centre(&self) -> [f64; 2] {
        [self.number("x") + self.number("width") / 2., self.number("y") + self.number("height") / 2.]
    }

    /// Points of a path made of `M` and `L`.
    pub(crate) fn points(&self) -> Vec<[f64; 2]> {
        let text = self.attributes["d"].replace(['M', 'L'], ";").replace('Z', "");
        let pair = |part: &str| {
            let mut numbers = part.split(' ').map(|n| n.parse::<f64>().unwrap());
            [numbers.next().unwrap(), numbers.next().unwrap()]
        };
        text.split(';').filter(|part| !part.is_empty()).map(pair).collect()
    }
}

/// Every element of a document; panics where tags do not balance.
pub(crate) fn read(svg: &str) -> Vec<Element> {
    let (mut elements, mut open): (Vec<Element>, Vec<(String, String)>) = (Vec::new(), Vec::new());
    let mut rest = svg;
    while let Some(at) = rest.find('<') {
        let end = at + rest[at..].find('>').expect("a tag ends");
        let (tag, after) = (&rest[at + 1..end], &rest[end + 1..]);
        if let Some(name) = tag.strip_prefix('/') {
            let (opened, _) = open.pop().expect("nothing to close");
            assert_eq!(opened, name, "tags do not balance");
        } else {
            let closed = tag.ends_with('/');
            let tag = tag.trim_end_matches('/');
            let (name, attributes) = tag.split_once(' ').unwrap_or((tag, ""));
            let attributes = attributes_of(attributes);
            let class = attributes.get("class").cloned().unwrap_or_default();
            let mut classes: Vec<String> = open.iter().map(|(_, class)| class.clone()).collect();
            classes.push(class.clone());
            let text = after[..after.find('<').unwrap_or(0)].trim().to_owned();
            elements.push(Element { name: name.to_owned(), attributes, classes, text });
            if !closed {
                open.push((name.to_owned(), class));
            }
        }
        rest = after;
    }
    assert!(open.is_empty(), "not closed: {open:?}");
    elements
}

fn attributes_of(text: &str) -> BTreeMap<String, String> {
    let mut parts = text.split('"');
    let mut attributes = BTreeMap::new();
    while let (Some(key), Some(value)) = (parts.next(), parts.next()) {
        let before = attributes.insert(key.trim().trim_end_matches('=').to_owned(), value.to_owned());
        assert!(before.is_none(), "an attribute twice: {text}");
    }
    attributes
}

/// Those of a tag and a class.
pub(crate) fn of<'a>(elements: &'a [Element], name: &str, class: &str) -> Vec<&'a Element> {
    elements.iter().filter(|e| e.name == name && e.is(class)).collect()
}

/// Every text of a drawing with its box (left, top, right, bottom) as it is painted; panics where a letter has no
/// glyph.
pub(crate) fn labels(svg: &str) -> Vec<(String, [f32; 4])> {
    let mut options = Options::default();
    for font in [&include_bytes!("../../fonts/DejaVuSans.ttf")[..], include_bytes!("../../fonts/DejaVuSans-Bold.ttf")] {
        options.fontdb_mut().load_font_data(font.to_vec());
    }
    let tree = Tree::from_str(svg, &options).unwrap();
    let mut found = Vec::new();
    collect(tree.root(), &mut found);
    found
}

fn collect(group: &Group, found: &mut Vec<(String, [f32; 4])>) {
    for node in group.children() {
        match node {
            Node::Group(inner) => collect(inner, found),
            Node::Text(text) => {
                let words: String = text.chunks().iter().map(|chunk| chunk.text()).collect();
                let glyphs = text.layouted().iter().flat_map(|span| &span.positioned_glyphs);
                assert!(glyphs.clone().count() > 0, "{words:?} is not drawn");
                for glyph in glyphs {
                    assert_ne!(glyph.id.0, 0, "no glyph for {:?} in {words:?}", glyph.text);
                }
                let area = text.abs_bounding_box();
                // A box has room above and below its letters.
                found.push((words, [area.left(), area.top() + 1., area.right(), area.bottom() - 1.]));
            }
            _ => {}
        }
    }
}
