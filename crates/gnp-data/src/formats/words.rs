//! Columns of words, of which most come again and again.

use std::collections::HashMap;

/// Rows of words as codes into a list of the different ones, in the order in which they appear.
#[derive(Clone, Debug, Default)]
pub(in crate::formats) struct Words {
    pub(in crate::formats) codes: Vec<u32>,
    pub(in crate::formats) list: Vec<String>,
    places: HashMap<String, u32>,
}

impl Words {
    pub(in crate::formats) fn push(&mut self, word: &str) {
        let last = self.codes.last().copied().filter(|code| self.list[*code as usize] == word);
        let code = last.or_else(|| self.places.get(word).copied()).unwrap_or_else(|| {
            let code = self.list.len() as u32;
            self.list.push(word.to_owned());
            self.places.insert(word.to_owned(), code);
            code
        });
        self.codes.push(code);
    }

    /// The word of each row.
    pub(in crate::formats) fn iter(&self) -> impl Iterator<Item = &str> {
        self.codes.iter().map(|code| self.list[*code as usize].as_str())
    }
}
