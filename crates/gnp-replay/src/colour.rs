//! Colours, those of the figures.

use gnp_plot::palette;

/// Red, green, blue and opacity, 0 to 255.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(pub [u8; 4]);

impl Colour {
    pub(crate) const BEST: Self = Self::of(palette::BEST);
    pub(crate) const OTHERS: Self = Self::of(palette::OTHERS);
    pub(crate) const HISTORY: Self = Self::of(palette::HISTORY);
    pub(crate) const PICKED: Self = Self::of(palette::TARGET);
    /// A vehicle of the evaluated subset. Boxes are see-through, so that it is darker than where they are not.
    pub(crate) const EVALUATED: Self = Self::of("#4a5260");
    /// Any other vehicle.
    pub(crate) const VEHICLE: Self = Self::of(palette::VEHICLE);
    pub(crate) const BOUNDARY: Self = Self::of(palette::INK);
    pub(crate) const CENTRE_LINE: Self = Self::of("#777777");
    pub(crate) const RING: Self = Self::of("#b9bfc8");
    #[cfg(feature = "rerun")]
    pub(crate) const ROAD: Self = Self::of(palette::ROAD);

    /// The opaque colour that is written as `#rrggbb`; black for what is none.
    pub(crate) fn parse(text: &str) -> Self {
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii());
        digits
            .filter(|digits| digits.bytes().all(|b| b.is_ascii_hexdigit()))
            .map_or(Self([0, 0, 0, 255]), |_| Self::of(text))
    }

    /// The opaque colour that is written as `#rrggbb`.
    const fn of(text: &str) -> Self {
        let text = text.as_bytes();
        let mut parts = [0, 0, 0, 255];
        let mut i = 0;
        while i < 3 {
            parts[i] = 16 * digit(text[1 + 2 * i]) + digit(text[2 + 2 * i]);
            i += 1;
        }
        Self(parts)
    }
}

const fn digit(letter: u8) -> u8 {
    match letter {
        b'0'..=b'9' => letter - b'0',
        _ => letter.to_ascii_lowercase() - b'a' + 10,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_read_as_they_are_written() {
        assert_eq!(Colour::of("#0072b2"), Colour([0, 0x72, 0xb2, 255]));
        assert_eq!(Colour::parse("#F5C400"), Colour([0xf5, 0xc4, 0, 255]));
        assert_eq!(Colour::parse("yellow"), Colour([0, 0, 0, 255]));
    }
}
