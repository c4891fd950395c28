//! Random changes of inputs, for the engine without coverage.

use rand::{Rng as _, SeedableRng as _, seq::IndexedRandom as _};
use rand_chacha::ChaCha8Rng;

use crate::Corpus;

/// Longest input that is tried, bytes.
pub const LONGEST_INPUT: usize = 4096;

/// Numbers at which arithmetic tends to go wrong.
const NUMBERS: [&str; 22] = [
    "0",
    "-1",
    "1",
    "2",
    "-0.0",
    "0.1",
    "1e-45",
    "1e-300",
    "1e9",
    "1e30",
    "1e38",
    "-1e39",
    "1e308",
    "127",
    "32768",
    "65536",
    "2147483647",
    "-2147483648",
    "4294967295",
    "9007199254740993",
    "9223372036854775807",
    "18446744073709551616",
];

/// Words that are no number, or one that is none.
const WORDS: [&str; 12] = ["NaN", "inf", "-inf", "", "null", "true", "\"", ",", ";", "\r\n", "\u{0}", "\u{feff}"];

/// Makes inputs without end: changed ones of a corpus, and some of random bytes.
pub(crate) struct Mutator<'a> {
    rng: ChaCha8Rng,
    corpus: &'a Corpus,
    words: &'a [&'a str],
}

impl<'a> Mutator<'a> {
    pub(crate) fn new(seed: u64, corpus: &'a Corpus, words: &'a [&'a str]) -> Self {
        Self { rng: ChaCha8Rng::seed_from_u64(seed), corpus, words }
    }

    /// The next input, at most [`LONGEST_INPUT`] bytes.
    pub(crate) fn next(&mut self) -> Vec<u8> {
        let from_nothing = self.rng.random_range(0..4) == 0;
        let mut input = match self.entry().filter(|_| !from_nothing) {
            Some(entry) => entry.to_vec(),
            None => return self.random(),
        };
        // Mostly one change or a few: many seldom pass the first check.
        for _ in 0..1 + self.rng.random_range(0u32..16).pow(2) / 32 {
            self.change(&mut input);
        }
        input.truncate(LONGEST_INPUT);
        input
    }

    /// An input of the corpus, half of the time a seed: changes of what is accepted get farther than changes of what is refused.
    fn entry(&mut self) -> Option<&'a [u8]> {
        let Corpus { seeds, committed } = self.corpus;
        let [first, second] = if self.rng.random() { [seeds, committed] } else { [committed, seeds] };
        let entry = first.choose(&mut self.rng).or_else(|| second.choose(&mut self.rng))?;
        Some(entry)
    }

    /// Random bytes, short ones more often.
    fn random(&mut self) -> Vec<u8> {
        let most = 1 << self.rng.random_range(3..11);
        let length = self.rng.random_range(1..most);
        let mut bytes = vec![0; length];
        self.rng.fill(&mut bytes[..]);
        // Runs of zeros: small counts, absent options.
        if self.rng.random() {
            let zeros = self.span(length);
            bytes[zeros].fill(0);
        }
        bytes
    }

    fn span(&mut self, length: usize) -> std::ops::Range<usize> {
        let start = self.rng.random_range(0..=length);
        let most = (length - start).min(1 << self.rng.random_range(0..9));
        start..start + self.rng.random_range(0..=most)
    }

    fn change(&mut self, input: &mut Vec<u8>) {
        let place = self.rng.random_range(0..=input.len());
        match self.rng.random_range(0..12) {
            0 if place < input.len() => input[place] ^= 1 << self.rng.random_range(0..8),
            1 if place < input.len() => input[place] = self.rng.random(),
            2 => {
                let some: [u8; 4] = self.rng.random();
                let count = self.rng.random_range(1..=4);
                input.splice(place..place, some.into_iter().take(count));
            }
            3 => {
                let span = self.span(input.len());
                input.drain(span);
            }
            4 => {
                let span = self.span(input.len());
                let copy = input[span].to_vec();
                input.splice(place..place, copy);
            }
            5 => input.truncate(place),
            6 => self.splice(input),
            7 | 8 => self.number(input, place),
            9 => {
                let word = self.word();
                let end = input.len().min(place + self.rng.random_range(0..=word.len()));
                input.splice(place..end, word.bytes());
            }
            _ => self.lines(input),
        }
    }

    fn word(&mut self) -> &'a str {
        let own = self.words.choose(&mut self.rng).copied();
        own.filter(|_| self.rng.random()).or_else(|| WORDS.choose(&mut self.rng).copied()).unwrap_or_default()
    }

    /// The beginning of this one and the end of another.
    fn splice(&mut self, input: &mut Vec<u8>) {
        let Some(other) = self.entry() else { return };
        let (keep, from) = (self.rng.random_range(0..=input.len()), self.rng.random_range(0..=other.len()));
        input.truncate(keep);
        input.extend_from_slice(&other[from..]);
    }

    /// Another number, or none, in place of the first that begins at `place` or after.
    fn number(&mut self, input: &mut Vec<u8>, place: usize) {
        let is_part = |byte: u8| byte.is_ascii_digit() || matches!(byte, b'.' | b'-' | b'+');
        let Some(start) = input[place..].iter().position(|byte| is_part(*byte)).map(|at| place + at) else { return };
        let end = input[start..].iter().position(|byte| !is_part(*byte)).map_or(input.len(), |at| start + at);
        let text = match self.rng.random_range(0..4) {
            0 => self.rng.random_range(-300i32..300).to_string(),
            1 => self.word().to_owned(),
            _ => NUMBERS.choose(&mut self.rng).copied().unwrap_or_default().to_owned(),
        };
        input.splice(start..end, text.into_bytes());
    }

    /// A line dropped, repeated or put elsewhere.
    fn lines(&mut self, input: &mut Vec<u8>) {
        let mut lines: Vec<&[u8]> = input.split_inclusive(|byte| *byte == b'\n').collect();
        if lines.len() < 2 {
            return;
        }
        let (one, other) = (self.rng.random_range(0..lines.len()), self.rng.random_range(0..lines.len()));
        match self.rng.random_range(0..3) {
            0 => drop(lines.remove(one)),
            1 => lines.insert(other, lines[one]),
            _ => lines.swap(one, other),
        }
        *input = lines.concat();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_inputs_and_none_is_too_long() {
        let committed = vec![b"p1,2,3\n4,5,6\n".to_vec(), vec![7; LONGEST_INPUT]];
        let corpus = Corpus { seeds: Vec::new(), committed };
        let make = |seed| {
            let mut mutator = Mutator::new(seed, &corpus, &["frame"]);
            (0..2000).map(|_| mutator.next()).collect::<Vec<_>>()
        };
        let made = make(1);
        assert_eq!(made, make(1));
        assert_ne!(made, make(2));
        assert!(made.iter().all(|input| input.len() <= LONGEST_INPUT));
        assert!(made.iter().any(|input| input.windows(5).any(|part| part == b"frame")));
        assert!(Mutator::new(1, &Corpus::default(), &[]).next().len() <= LONGEST_INPUT);
    }

    #[test]
    fn half_of_the_inputs_come_from_seeds() {
        let corpus = Corpus { seeds: vec![vec![1]], committed: vec![vec![2]; 40] };
        let mut mutator = Mutator::new(1, &corpus, &[]);
        let seeds = (0..1000).filter(|_| mutator.entry() == Some(&[1])).count();
        assert!((400..600).contains(&seeds), "{seeds}");
    }
}
