//! Every term of the table: its descriptor is usable in files, and its gradient is that of its value.
use gnp_force::na::{Point2, Vector2};
use gnp_force::{Arity, MarkingKind, Side, Source, State, TermDescriptor, term, terms};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const STEP: f64 = 1e-5;

/// The source of that arity, whose place and velocity are `at`.
fn source(arity: Arity, kind: MarkingKind, at: [f64; 4]) -> Source<f64> {
    match arity {
        Arity::One => Source::Goal { goal: Point2::new(at[0], at[1]), time_left: 2.5 },
        Arity::PerNeighbour => Source::Vehicle { slot: 0, state: State::new(at[0], at[1], at[2], at[3]) },
        Arity::PerLine => Source::Line { kind, y: at[1], road: Side::Left },
    }
}

#[test]
fn gradients_are_those_of_the_force() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    for term in terms::<f64>() {
        let descriptor = term.descriptor();
        for case in 0..60 {
            let kind = if case % 2 == 0 { MarkingKind::Boundary } else { MarkingKind::LaneDivider };
            let parameters: Vec<f64> = descriptor.parameters.iter().map(|_| rng.random_range(0.5..3.)).collect();
            // State, source, parameters; a line stands to the right of the vehicle, off its kinks.
            let mut inputs: Vec<f64> = vec![
                rng.random_range(-9.0..9.0),
                rng.random_range(1.0..3.0),
                rng.random_range(-5.0..5.0),
                rng.random_range(-5.0..5.0),
                rng.random_range(-9.0..9.0),
                rng.random_range(-0.5..0.4),
                rng.random_range(-5.0..5.0),
                rng.random_range(-5.0..5.0),
            ];
            inputs.extend(&parameters);
            let cotangent = Vector2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
            let parts = |inputs: &[f64]| {
                let state = State::new(inputs[0], inputs[1], inputs[2], inputs[3]);
                (state, source(descriptor.arity, kind, [inputs[4], inputs[5], inputs[6], inputs[7]]))
            };
            let value = |inputs: &[f64]| {
                let (state, source) = parts(inputs);
                term.force(&state, &source, &inputs[8..]).dot(&cotangent)
            };
            let (state, from) = parts(&inputs);
            let mut dparameters = vec![f64::NAN; parameters.len()];
            let vjp = term.vjp(&state, &from, &parameters, cotangent, &mut dparameters);
            let mut gradient: Vec<f64> = Vec::new();
            for part in [vjp.position, vjp.velocity, vjp.source_position, vjp.source_velocity] {
                gradient.extend(part.iter());
            }
            gradient.extend(dparameters);
            for (i, found) in gradient.into_iter().enumerate() {
                let (mut up, mut down) = (inputs.clone(), inputs.clone());
                up[i] += STEP;
                down[i] -= STEP;
                let wanted = (value(&up) - value(&down)) / (2. * STEP);
                assert!((found - wanted).abs() < 1e-6 * wanted.abs().max(1.), "{term:?}, input {i}: {found}, {wanted}");
            }
        }
    }
}

#[test]
fn names_are_distinct_and_fit_in_files() {
    let plain = |name: &str| {
        !name.is_empty() && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_')
    };
    let all = terms::<f32>();
    for (i, one) in all.iter().enumerate() {
        let descriptor = one.descriptor();
        assert!(plain(&descriptor.name) && descriptor.parameters.iter().all(|p| plain(&p.name)), "{descriptor:?}");
        assert!(descriptor.colour.len() == 7 && descriptor.colour.starts_with('#'), "{descriptor:?}");
        let differ = |other: &TermDescriptor| other.name != descriptor.name && other.colour != descriptor.colour;
        assert!(all[..i].iter().all(|other| differ(other.descriptor())), "{descriptor:?}");
        assert_eq!(term::<f32>(&descriptor.name).unwrap().descriptor(), descriptor);
        let text = serde_json::to_string(descriptor).unwrap();
        assert_eq!(&serde_json::from_str::<TermDescriptor>(&text).unwrap(), descriptor);
    }
    assert!(term::<f64>("gravity").is_none());
}

#[test]
fn a_source_or_parameters_of_another_term_give_no_force() {
    let state = State::new(0., 1., 2., 3.);
    for term in terms::<f64>() {
        let parameters = vec![1.; term.descriptor().parameters.len()];
        for arity in [Arity::One, Arity::PerNeighbour, Arity::PerLine] {
            let from = source(arity, MarkingKind::Boundary, [5., 0.5, 1., 1.]);
            let force = term.force(&state, &from, &parameters);
            assert_eq!(force != Vector2::zeros(), arity == term.descriptor().arity, "{term:?} from {arity:?}");
            assert_eq!(term.force(&state, &from, &[]), Vector2::zeros());
        }
    }
}
