//! Goldens: the lidar fixture (see `data/README.md`) on both kernels, at its own tolerances.

use jostle_sim::{Hit, LaserConfig, LaserKernel, ScanScene};
use serde_json::Value;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("array").iter().map(|x| x.as_f64().expect("number")).collect()
}

fn triple(value: &Value) -> [f64; 3] {
    numbers(value).try_into().expect("three numbers")
}

fn pair(value: &Value) -> [f64; 2] {
    numbers(value).try_into().expect("two numbers")
}

fn list<T>(value: &Value, item: impl Fn(&Value) -> T) -> Vec<T> {
    value.as_array().expect("array").iter().map(item).collect()
}

fn scene(json: &Value, side: f64) -> ScanScene {
    ScanScene {
        room: Some((pair(&json["room"]["min"]), pair(&json["room"]["max"]))),
        sensor: triple(&json["sensor"]),
        bodies: list(&json["bodies"], triple),
        body_side: side,
        invisible: list(&json["invisible"], |i| i.as_u64().expect("index") as usize),
        polygons: list(&json["polygons"], |polygon| list(polygon, pair)),
    }
}

fn hit(json: &Value) -> Hit {
    let index = json[1].as_u64().unwrap_or(0) as usize;
    match json[0].as_str() {
        None => Hit::None,
        Some("wall") => Hit::Wall(index),
        Some("body") => Hit::Body(index),
        Some("polygon") => Hit::Obstacle(index),
        Some(other) => panic!("unknown hit {other}"),
    }
}

#[track_caller]
fn check(kernel: LaserKernel) {
    let json: Value = serde_json::from_str(include_str!("data/lidar.json")).expect("JSON");
    let config = LaserConfig { kernel, ..LaserConfig::default() };
    let (mut n, mut n_rough, mut worst) = (0, 0, 0.0_f64);
    for case in json["scenes"].as_array().expect("scenes") {
        let (name, expected) = (&case["name"], &case["expected"]);
        let scan = scene(case, json["body_side"].as_f64().expect("side")).scan(&config).expect("scan");
        let mut unstable = [None; 512];
        for beam in expected["unstable_beams"].as_array().expect("array") {
            let ends = [&beam["low"], &beam["high"]].map(|x| x.as_f64().expect("number"));
            unstable[beam["beam"].as_u64().expect("index") as usize] = Some(ends);
        }
        for (k, wanted) in numbers(&expected["ranges"]).into_iter().enumerate() {
            let found = f64::from(scan.ranges[k]);
            if let Some([low, high]) = unstable[k] {
                assert!(found >= low - 1e-3 && found <= high + 1e-3, "{name} beam {k}: {found}");
                continue;
            }
            let error = (found - wanted).abs();
            assert!(error <= 1e-3, "{name} beam {k}: {found}, expected {wanted}");
            assert_eq!(scan.hits[k], hit(&expected["hit"][k]), "{name} beam {k}");
            n += 1;
            n_rough += usize::from(error > 1e-4);
            worst = worst.max(error);
        }
        let min_range = expected["min_range"].as_f64().expect("number");
        assert!((f64::from(scan.min_range) - min_range).abs() < 1e-3, "{name}");
        assert_eq!(scan.min_range < 0.5, expected["crash"].as_bool().expect("boolean"), "{name}");
    }
    assert!(n_rough * 1000 <= n, "{n_rough} of {n} beams are off by more than 1e-4 m");
    assert!(worst < 1e-4, "worst error {worst:e} m");
}

#[test]
fn analytic_kernel_meets_the_fixture() {
    check(LaserKernel::Analytic);
}

#[test]
fn parry_kernel_meets_the_fixture() {
    check(LaserKernel::Parry);
}
