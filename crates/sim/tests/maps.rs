//! Map files: what is read, and how each kind of bad input is refused.

use glam::Vec2;
use jostle_sim::{Rooms, SimConfig, Streams, maps};
use std::path::PathBuf;
use tempfile::TempDir;

fn write(files: &[(&str, &[u8])]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("folder");
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).expect("file");
    }
    let path = folder.path().join(files[0].0);
    (folder, path)
}

/// The message, without the folder of the file it names.
#[track_caller]
fn refused(files: &[(&str, &[u8])]) -> String {
    let (folder, path) = write(files);
    let message = maps::load(&path).expect_err("refused").to_string();
    assert!(!message.contains('\n'), "one line: {message}");
    message.replace(&format!("{}/", folder.path().display()), "")
}

const WALLS: &str = "walls = { min = [-10, -10], max = [10, 10] }\n";
const YAML: &str = "image: m.pgm\nresolution: 0.5\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\n\
                    occupied_thresh: 0.65\nfree_thresh: 0.196\n";

#[test]
fn polygon_maps_in_toml_and_json_are_the_same() {
    let toml = format!(
        "{WALLS}[[obstacle]]\npolygon = [[1, 0], [2, 0], [1.5, 1]]\n[[obstacle]]\nsegment = [[-3, 0], [-3, 4]]\n\
         [[obstacle]]\ncircle = {{ centre = [5, 5], radius = 0.4 }}\n\
         [[obstacle]]\nbox = {{ centre = [0, -5], length = 2, width = 0.5 }}\n"
    );
    let json = r#"{"walls": {"min": [-10, -10], "max": [10, 10]}, "obstacle": [
        {"polygon": [[1, 0], [2, 0], [1.5, 1]]}, {"segment": [[-3, 0], [-3, 4]]},
        {"circle": {"centre": [5, 5], "radius": 0.4}},
        {"box": {"centre": [0, -5], "length": 2, "width": 0.5}}]}"#;
    let (_a, toml) = write(&[("m.toml", toml.as_bytes())]);
    let (_b, json) = write(&[("m.json", json.as_bytes())]);
    let scenario = maps::load(&toml).expect("TOML");
    assert_eq!(scenario, maps::load(&json).expect("JSON"));
    assert_eq!(scenario.obstacles.len(), 4);
    let mut config = SimConfig::default();
    config.room.map = Some(toml);
    let mut rooms = Rooms::new(&config, 1, 3, 1, &Streams::new(0)).expect("rooms");
    rooms.step(&[[1.0, 0.1]; 3]);
}

#[test]
fn bad_polygon_maps_are_refused_in_one_line() {
    let clockwise = format!("{WALLS}[[obstacle]]\npolygon = [[1, 0], [1.5, 1], [2, 0]]\n");
    let message = refused(&[("m.toml", clockwise.as_bytes())]);
    assert!(message.starts_with("m.toml: obstacle 0: found a turn to the right"), "{message}");
    let unknown = format!("{WALLS}colour = 3\n");
    assert!(refused(&[("m.toml", unknown.as_bytes())]).contains("unknown field `colour`"));
    assert!(refused(&[("m.json", b"{")]).starts_with("m.json: content: found EOF"));
    assert!(refused(&[("m.txt", b"")]).starts_with("m.txt: extension: found txt"));
    let flat = "walls = { min = [1, 1], max = [1, 2] }";
    assert!(refused(&[("m.toml", flat.as_bytes())]).starts_with("m.toml: walls: found"));
    let missing = maps::load(&PathBuf::from("/nowhere/m.toml")).expect_err("missing").to_string();
    assert!(missing.starts_with("/nowhere/m.toml: file: found"), "{missing}");
}

#[test]
fn grids_are_read_from_both_pgm_formats_and_png() {
    let text = b"P2\n# a comment\n4 3\n255\n254 254 0 0\n0 205 254 254\n0 0 254 254\n";
    let pixels = [254, 254, 0, 0, 0, 205, 254, 254, 0, 0, 254, 254];
    let binary = [b"P5 4 3 255\n".as_slice(), &pixels].concat();
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, 4, 3);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().expect("header").write_image_data(&pixels).expect("pixels");
    let scenarios = [text.to_vec(), binary, png].map(|image| {
        let (_folder, path) = write(&[("m.yaml", YAML.as_bytes()), ("m.pgm", &image)]);
        maps::load(&path).expect("map")
    });
    assert!(scenarios[0] == scenarios[1] && scenarios[0] == scenarios[2]);
    assert_eq!(scenarios[0].walls, (Vec2::new(-1.0, -2.0), Vec2::new(1.0, -0.5)));
    // The image's last row is the world's lowest; the unknown cell (205) is solid.
    let world = scenarios[0].build().expect("world");
    assert_eq!(world.n_obstacles(), 2);
    assert_eq!(world.clearance(Vec2::new(-0.25, -1.25)), 0.0);
    assert_eq!(world.clearance(Vec2::new(0.75, -0.75)), 0.0);
    assert!(world.clearance(Vec2::new(-0.75, -0.75)) > 0.2);
}

#[test]
fn bad_grids_are_refused_in_one_line() {
    let good: &[u8] = b"P5 2 1 255\n\xFE\xFE";
    let yaml = |from: &str, to: &str, image: &[u8]| {
        refused(&[("m.yaml", YAML.replace(from, to).as_bytes()), ("m.pgm", image)])
    };
    assert!(yaml("0.5", "fast", good).starts_with("m.yaml: resolution: found fast, expected a number"));
    assert!(yaml("0.0]", "0.7]", good).starts_with("m.yaml: origin: found [-1.0, -2.0, 0.7]"));
    assert!(yaml("negate: 0\n", "", good).starts_with("m.yaml: negate: found nothing"));
    assert!(yaml("negate", "negative", good).starts_with("m.yaml: line 4: found negative"));
    assert!(yaml("m.pgm", "n.pgm", good).starts_with("n.pgm: file: found No such file"));
    assert!(yaml("", "", b"P5 2 1 255\n\xFE").starts_with("m.pgm: pixels: found 1 bytes, expected 2"));
    assert!(yaml("", "", b"P5 99999999 99999999 255\n").starts_with("m.pgm: size: found 99999999 by"));
    assert!(yaml("", "", b"P2 1 1 255\nx").starts_with("m.pgm: pixel: found byte 120"));
    assert!(yaml("", "", b"P2 1 1 100\n101").starts_with("m.pgm: pixel: found 101, expected at most 100"));
    assert!(yaml("", "", b"GIF89a").starts_with("m.pgm: first bytes: found something else"));
    assert!(yaml("", "", b"\x89PNG\r\n\x1a\nrubbish").starts_with("m.pgm: PNG: found"));
}
