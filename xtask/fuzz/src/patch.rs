//! Changes of JSON values: a leaf replaced, a key left out or added, an array made shorter or longer.

use arbitrary::Arbitrary;
use serde_json::{Number, Value};

/// A change at one place of a value.
#[derive(Arbitrary, Clone, Debug)]
pub(crate) struct Patch {
    /// Which place, counted through all of them.
    place: u16,
    change: Change,
}

#[derive(Arbitrary, Clone, Debug)]
enum Change {
    Number(Numeral),
    Whole(i64),
    Real(f64),
    Text(u8),
    Null,
    Bool(bool),
    Empty(bool),
    Drop,
    Double,
    Key(u8),
}

/// Numbers at which arithmetic tends to go wrong.
#[derive(Arbitrary, Clone, Copy, Debug)]
enum Numeral {
    Zero,
    One,
    Minus,
    Small,
    Byte,
    Short,
    Word,
    Long,
    Most,
    Tiny,
    Large,
    Huge,
}

impl Numeral {
    fn value(self) -> Value {
        match self {
            Self::Zero => 0.into(),
            Self::One => 1.into(),
            Self::Minus => (-1).into(),
            Self::Small => 3.into(),
            Self::Byte => 255.into(),
            Self::Short => 65_536.into(),
            Self::Word => u32::MAX.into(),
            Self::Long => i64::MAX.into(),
            Self::Most => u64::MAX.into(),
            Self::Tiny => 1e-300.into(),
            Self::Large => 1e9.into(),
            Self::Huge => 1e308.into(),
        }
    }
}

/// Texts that are a name of nothing.
const TEXTS: [&str; 6] = ["", "x", "../x", "1", "a\u{1b}[31m", "us-101"];

/// Applies every patch, one after the other.
pub(crate) fn apply(value: &mut Value, patches: &[Patch]) {
    for patch in patches {
        let count = places(value);
        let mut left = usize::from(patch.place) % count.max(1);
        visit(value, &mut left, &patch.change);
    }
}

/// Leaves, arrays and objects of `value`, itself included.
fn places(value: &Value) -> usize {
    1 + match value {
        Value::Array(items) => items.iter().map(places).sum(),
        Value::Object(entries) => entries.values().map(places).sum::<usize>(),
        _ => 0,
    }
}

/// Whether the place was found below `value`.
fn visit(value: &mut Value, left: &mut usize, change: &Change) -> bool {
    if *left == 0 {
        put(value, change);
        return true;
    }
    *left -= 1;
    match value {
        Value::Array(items) => items.iter_mut().any(|item| visit(item, left, change)),
        Value::Object(entries) => entries.values_mut().any(|entry| visit(entry, left, change)),
        _ => false,
    }
}

fn put(value: &mut Value, change: &Change) {
    let made = match change {
        Change::Number(numeral) => numeral.value(),
        Change::Whole(number) => (*number).into(),
        Change::Real(number) => Number::from_f64(*number).map_or(Value::Null, Value::Number),
        Change::Text(which) => TEXTS[usize::from(*which) % TEXTS.len()].into(),
        Change::Null => Value::Null,
        Change::Bool(which) => (*which).into(),
        Change::Empty(array) => {
            if *array {
                Value::Array(Vec::new())
            } else {
                Value::Object(Default::default())
            }
        }
        Change::Drop | Change::Double | Change::Key(_) => return reshape(value, change),
    };
    *value = made;
}

fn reshape(value: &mut Value, change: &Change) {
    match (value, change) {
        (Value::Array(items), Change::Drop) => drop(items.pop()),
        (Value::Array(items), _) => items.extend(items.last().cloned()),
        (Value::Object(entries), Change::Key(which)) => {
            let key = entries.keys().nth(usize::from(*which) % entries.len().max(1)).cloned();
            if let Some(key) = key {
                entries.remove(&key);
            }
        }
        (Value::Object(entries), _) => drop(entries.insert("more".to_owned(), Value::Null)),
        (Value::Number(number), Change::Double) => {
            *number = Number::from_f64(number.as_f64().unwrap_or_default() * 2.).unwrap_or(number.clone());
        }
        (other, _) => *other = Value::Null,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn each_place_can_be_changed() {
        let given = json!({"a": [1, {"b": 2.5}], "c": "x"});
        let mut seen = Vec::new();
        for place in 0..6 {
            let mut value = given.clone();
            apply(&mut value, &[Patch { place, change: Change::Null }]);
            assert_ne!(value, given);
            assert!(!seen.contains(&value));
            seen.push(value);
        }
        let mut value = given.clone();
        apply(&mut value, &[Patch { place: 6, change: Change::Null }]);
        assert_eq!(value, Value::Null, "places are counted round");
    }

    #[test]
    fn keys_go_and_arrays_grow() {
        let mut value = json!({"a": [1], "c": 2});
        let patches = [
            Patch { place: 0, change: Change::Key(1) },
            Patch { place: 1, change: Change::Double },
            Patch { place: 2, change: Change::Number(Numeral::Word) },
        ];
        apply(&mut value, &patches);
        assert_eq!(value, json!({"a": [u32::MAX, 1]}));
    }
}
