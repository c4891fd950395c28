//! Colours. Forces have those of their descriptors, which are the GNP paper's; the rest told apart by colour-blind readers (Okabe and Ito)
//! and, by lightness and dashes, without colour.

/// All forces together.
pub(crate) const TOTAL: &str = "#d55e00";
/// What stands beside the best.
pub(crate) const BLUE: &str = "#0072b2";
/// The best of K futures.
pub const BEST: &str = "#8b0000";
/// The other futures.
pub const OTHERS: &str = "#32cd32";
/// What happened.
pub(crate) const TRUTH: &str = "#000000";
/// What was observed.
pub const HISTORY: &str = "#56606e";
/// The target's box.
pub const TARGET: &str = "#d55e00";
/// Boxes of other vehicles.
pub const VEHICLE: &str = "#aeb6c2";
/// Asphalt.
pub const ROAD: &str = "#eef0f3";
/// Frames and letters.
pub const INK: &str = "#222222";
/// Grid.
pub(crate) const GRID: &str = "#dfe3e8";

/// Colour and dashes of the `i`-th series of a chart.
pub(crate) fn series(i: usize) -> (&'static str, &'static str) {
    const SERIES: [(&str, &str); 7] = [
        ("#8b0000", "none"),
        ("#0072b2", "6 2.5"),
        ("#e69f00", "2 2"),
        ("#009e73", "8 2.5 2 2.5"),
        ("#cc79a7", "4 4"),
        ("#56b4e9", "none"),
        ("#555555", "1 3"),
    ];
    SERIES[i % SERIES.len()]
}

/// The rim that makes a light colour `#rrggbb`, such as the goal's yellow, visible on white: the same one, darkened. None
/// for a dark colour.
pub(crate) fn rim(colour: &str) -> Option<String> {
    let part = |i: usize| colour.get(i..i + 2).and_then(|text| u8::from_str_radix(text, 16).ok()).map(f64::from);
    let [r, g, b] = [part(1)?, part(3)?, part(5)?];
    let light = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let dark = |c: f64| (c * 0.43).round() as u8;
    (light > 140.).then(|| format!("#{:02x}{:02x}{:02x}", dark(r), dark(g), dark(b)))
}

/// The cividis scale (Nuñez, Anderton and Renslow 2018) at `t` from 0 to 1, dark blue to yellow: rises
/// evenly in lightness, with and without colour vision.
pub(crate) fn cividis(t: f64) -> String {
    const STOPS: [[f64; 3]; 9] = [
        [0., 34., 78.],
        [18., 53., 112.],
        [59., 73., 108.],
        [87., 93., 109.],
        [112., 113., 115.],
        [138., 134., 120.],
        [165., 156., 116.],
        [195., 180., 105.],
        [254., 232., 56.],
    ];
    let t = if t.is_finite() { t.clamp(0., 1.) } else { 0. } * (STOPS.len() - 1) as f64;
    let i = (t as usize).min(STOPS.len() - 2);
    let mix = |c: usize| (STOPS[i][c] + (STOPS[i + 1][c] - STOPS[i][c]) * (t - i as f64)).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mix(0), mix(1), mix(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_colours_have_a_rim_and_dark_ones_have_none() {
        assert_eq!(rim("#f5c400").as_deref(), Some("#695400"));
        assert!(rim("#0072b2").is_none() && rim("#000000").is_none() && rim("yellow").is_none());
    }

    #[test]
    fn the_scale_ends_where_it_should_and_rises() {
        assert_eq!(cividis(0.), "#00224e");
        assert_eq!(cividis(1.), "#fee838");
        assert_eq!(cividis(f64::NAN), "#00224e");
        let light = |t: f64| {
            let text = cividis(t);
            let part = |i| f64::from(u8::from_str_radix(&text[i..i + 2], 16).unwrap());
            0.2126 * part(1) + 0.7152 * part(3) + 0.0722 * part(5)
        };
        for i in 0..20 {
            assert!(light(f64::from(i) / 20.) < light(f64::from(i + 1) / 20.), "{i}");
        }
    }
}
