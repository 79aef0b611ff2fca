//! The files that the program brings, for where there is no checkout: configurations, maps, and the
//! policies that `demo` shows.

use jostle_runs::shipped::Embedded;

macro_rules! files {
    ($($path:literal),* $(,)?) => {
        &[$(Embedded { path: $path, bytes: include_bytes!(concat!("../../../", $path)) }),*]
    };
}

/// All of them, by their paths below the root of a checkout.
pub(crate) static FILES: &[Embedded] = files![
    "configs/baseline_m1.toml",
    "configs/diversity_m5.toml",
    "configs/headline.toml",
    "configs/plans/embedding.toml",
    "configs/plans/study-10m.toml",
    "configs/plans/study-paper.toml",
    "configs/plans/study.toml",
    "configs/safety_zone.toml",
    "configs/small_m1.toml",
    "configs/small_m5.toml",
    "configs/strong.toml",
    "configs/study.toml",
    "maps/hospital.toml",
    "maps/obstacle.toml",
    "maps/warehouse.toml",
    "checkpoints/m5-seed1-005000.safetensors",
    "checkpoints/strong-seed1-002035.safetensors",
];

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::{Path, PathBuf};

    use super::FILES;

    #[test]
    fn every_configuration_and_map_is_brought() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let mut found = BTreeSet::new();
        for folder in ["configs", "configs/plans", "maps"] {
            for entry in std::fs::read_dir(root.join(folder)).unwrap() {
                let name = entry.unwrap().file_name().into_string().unwrap();
                if PathBuf::from(&name).extension().is_some() {
                    found.insert(format!("{folder}/{name}"));
                }
            }
        }
        let brought =
            FILES.iter().map(|file| file.path.to_owned()).filter(|path| !path.starts_with("checkpoints/"));
        assert_eq!(brought.collect::<BTreeSet<_>>(), found);
    }
}
