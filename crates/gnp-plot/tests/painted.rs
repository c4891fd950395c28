//! Figures as PNG, read back: colours where they should be, letters that are drawn, the same bytes.

#![allow(clippy::unwrap_used)] // helpers of tests

use gnp_plot::{Figure, Painter};
use resvg::tiny_skia::Pixmap;

/// A drawing of 60 by 30 units: blue on the left, a yellow square on the right, words over nothing.
fn figure(words: &str) -> Figure {
    let svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"60\" height=\"30\" viewBox=\"0 0 60 30\" \
         font-family=\"'DejaVu Sans', Verdana\"><rect width=\"60\" height=\"30\" fill=\"#fff\"/>\
         <rect width=\"20\" height=\"30\" fill=\"#0072b2\"/><rect x=\"40\" y=\"10\" width=\"10\" height=\"10\" \
         fill=\"#f5c400\"/><text x=\"22\" y=\"9\" font-size=\"9\">{words}</text></svg>"
    );
    Figure { name: "tiny".to_owned(), caption: String::new(), svg }
}

fn painted(figure: &Figure) -> Pixmap {
    Pixmap::decode_png(&Painter::new().png(figure).unwrap()).unwrap()
}

fn colour(picture: &Pixmap, x: u32, y: u32) -> [u8; 3] {
    let pixel = picture.pixel(x, y).unwrap();
    [pixel.red(), pixel.green(), pixel.blue()]
}

#[test]
fn colours_stand_where_they_were_drawn_two_pixels_a_unit() {
    let picture = painted(&figure(""));
    assert_eq!((picture.width(), picture.height()), (120, 60));
    for (at, expected) in [
        ((0, 0), [0, 0x72, 0xb2]),
        ((39, 59), [0, 0x72, 0xb2]),
        ((40, 59), [255; 3]),
        ((79, 30), [255; 3]),
        ((80, 20), [0xf5, 0xc4, 0]),
        ((99, 39), [0xf5, 0xc4, 0]),
        ((99, 40), [255; 3]),
    ] {
        assert_eq!(colour(&picture, at.0, at.1), expected, "{at:?}");
    }
}

/// Counts pixels that are not white in the strip of the words.
fn ink(picture: &Pixmap) -> usize {
    let strip = (40..120).flat_map(|x| (0..20).map(move |y| (x, y)));
    strip.filter(|(x, y)| colour(picture, *x, *y) != [255; 3]).count()
}

#[test]
fn letters_are_drawn_with_the_fonts_of_the_crate() {
    let (none, one, two) = (painted(&figure("")), painted(&figure("I")), painted(&figure("I\u{2212}\u{b2}m")));
    assert_eq!(ink(&none), 0);
    assert!(ink(&one) > 10 && ink(&two) > 2 * ink(&one), "{} {}", ink(&one), ink(&two));
    let bold = Figure { svg: figure("I").svg.replace("<text", "<text font-weight=\"bold\""), ..figure("I") };
    assert!(ink(&painted(&bold)) > ink(&one), "bold letters have a font of their own");
}

#[test]
fn the_same_figure_gives_the_same_bytes() {
    let (first, second) = (Painter::new(), Painter::new());
    assert_eq!(first.png(&figure("words")).unwrap(), second.png(&figure("words")).unwrap());
    assert_ne!(first.png(&figure("words")).unwrap(), first.png(&figure("word")).unwrap());
}

#[test]
fn what_is_no_drawing_is_refused_by_name() {
    let broken = Figure { svg: "<svg".to_owned(), ..figure("") };
    let error = Painter::new().png(&broken).unwrap_err();
    assert!(error.to_string().contains("tiny"), "{error}");
}
