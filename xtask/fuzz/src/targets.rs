//! The targets, one a file.

mod checkpoint;
mod configuration;
mod fcd;
mod highd;
mod live;
mod ngsim;
mod predictions;
mod recording;
mod request;
mod road;
mod scene;
mod split;
mod stream;
mod table_text;
mod tracks;

use crate::Target;

/// Every target, by name.
pub const TARGETS: &[Target] = &[
    checkpoint::TARGET,
    configuration::TARGET,
    fcd::TARGET,
    highd::TARGET,
    live::TARGET,
    ngsim::TARGET,
    predictions::TARGET,
    recording::TARGET,
    request::TARGET,
    road::TARGET,
    scene::TARGET,
    split::TARGET,
    stream::TARGET,
    table_text::TARGET,
    tracks::TARGET,
];

#[cfg(test)]
mod tests {
    use crate::{Failure, LONGEST_INPUT, Limits, Scratch, Target, run};

    /// Random inputs of each target in a test run.
    const SOME: u64 = 400;

    /// Replays the corpus of a target and some hundred changes of it.
    fn replay(name: &str) {
        let target = Target::named(name).unwrap();
        let scratch = Scratch::new().unwrap();
        let corpus = target.corpus(&scratch).unwrap();
        assert!(!corpus.seeds.is_empty());
        assert!(corpus.iter().all(|input| input.len() <= LONGEST_INPUT));
        let limits = Limits { executions: Some(corpus.iter().count() as u64 + SOME), ..Limits::default() };
        let outcome = run(target, &scratch, &corpus, &limits, &mut |_, _| {});
        let shown = |failure: &Failure| format!("{}\n{}\n", failure.what, failure.input.escape_ascii());
        let failures: String = outcome.failures.iter().map(shown).collect();
        assert!(failures.is_empty(), "{failures}");
    }

    /// One test a target, so that they run side by side.
    macro_rules! replays {
        ($($name:ident)*) => {
            $(#[test]
            fn $name() {
                replay(stringify!($name));
            })*

            #[test]
            fn none_is_left_out() {
                let known: Vec<&str> = super::TARGETS.iter().map(|target| target.name).collect();
                assert_eq!(known, [$(stringify!($name)),*]);
            }
        };
    }

    replays!(
        checkpoint configuration fcd highd live ngsim predictions recording request road scene split stream table_text
        tracks
    );
}
