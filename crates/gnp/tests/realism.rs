//! Closed-loop traffic beside the recordings that come with the project.
use gnp::{Machine, RealismPlan, realism};
use gnp_data::Dataset;

#[test]
fn systems_drive_on_from_real_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let mut plan = RealismPlan::embedded(Dataset::NGSIM);
    plan.settings.roll_outs = 2;
    plan.sumo = Some(folder.path().to_owned());
    let table = realism(&plan, &Machine::default()).unwrap();
    for site in ["i-80", "us-101"] {
        let rows: Vec<_> = table.rows.iter().filter(|row| row.site == site).collect();
        let of = |system: &str| rows.iter().find(|row| row.system == system).unwrap();
        assert!(rows[0].horizons.iter().all(|it| it.ade.mean == 0.0) && !rows[0].simulated, "{site}");
        let (constant, standard) = (of("constant velocity"), of("IDM, standard"));
        assert!(standard.contacts_per_vehicle_h.unwrap() < 0.2 * constant.contacts_per_vehicle_h.unwrap(), "{site}");
        // Drivers who explain the observed seconds are nearer to what happens than any.
        let ade = |system: &str| of(system).horizons[0].ade.mean;
        assert!(ade("IDM, others who fit the past") < ade("IDM, other drivers drawn, unsteady"), "{site}");
        assert!(rows.iter().all(|row| row.realism.unwrap().mean <= rows[0].realism.unwrap().mean), "{site}");
        assert!(
            rows.iter().all(|row| row.uses_future == ["what happened", "IDM, his own driver"].contains(&&*row.system))
        );
    }
    // Scenes for SUMO are there; without its courses it has no row.
    let written = std::fs::read_dir(folder.path().join("medians")).unwrap().count();
    assert!(written > 20 && table.rows.iter().all(|row| !row.system.contains("SUMO")));
}
