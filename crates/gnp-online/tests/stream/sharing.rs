//! One model, many streams on many threads.

use gnp_model::Gnp;
use gnp_online::{Stream, StreamConfig, Tracked};

use crate::SHAPE;
use crate::model::{lines, model};

fn drive(gnp: &Gnp, speed: f64) -> Vec<[f64; 2]> {
    let mut stream = Stream::new(gnp, lines(), StreamConfig::default()).unwrap();
    let mut all = Vec::new();
    for i in 0..40 {
        let time_s = 0.1 * f64::from(i);
        let tracks = [0u8, 1, 2].map(|it| {
            let y = if it == 1 { 5.5 } else { 1.8 };
            Tracked::new(it.into(), [30. * f64::from(it) + (speed + f64::from(it)) * time_s, y])
        });
        all.extend(stream.push(time_s, &tracks).unwrap().paths());
    }
    all
}

#[test]
fn streams_on_threads_share_a_model_and_do_not_disturb_one_another() {
    fn sent<T: Send>() {}
    fn shared<T: Send + Sync>() {}
    sent::<Stream>();
    shared::<Gnp>();
    let gnp = model(SHAPE);
    let expected: Vec<_> = [20., 25., 30.].into_iter().map(|speed| drive(&gnp, speed)).collect();
    std::thread::scope(|scope| {
        let running: Vec<_> = [20., 25., 30.]
            .map(|speed| {
                let gnp = &gnp;
                scope.spawn(move || drive(gnp, speed))
            })
            .into_iter()
            .collect();
        for (running, expected) in running.into_iter().zip(&expected) {
            assert!(&running.join().unwrap() == expected);
        }
    });
}
