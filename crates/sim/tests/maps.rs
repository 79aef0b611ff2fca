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
    assert!(yaml("0.0]", "here]", good).starts_with("m.yaml: origin: found [-1.0, -2.0, here]"));
    assert!(
        yaml(", 0.0]", "]", good).starts_with("m.yaml: origin: found [-1.0, -2.0], expected [x, y, yaw]")
    );
    assert!(yaml("-1.0,", "-1500.0,", good).starts_with("m.yaml: origin: found [-1500.0"));
    assert!(yaml("negate: 0", "negate: maybe", good).starts_with("m.yaml: negate: found maybe"));
    assert!(yaml("negate: 0", "mode: costmap\nnegate: 0", good).starts_with("m.yaml: mode: found costmap"));
    assert!(yaml("negate: 0", "negate: 0\nnegate: 1", good).starts_with("m.yaml: negate: found a second"));
    assert!(yaml("image: m.pgm", "image: [m.pgm]", good).starts_with("m.yaml: image: found [m.pgm]"));
    let message = yaml("image: m.pgm", "image: [m.pgm", good);
    assert!(message.starts_with("m.yaml: line 2, column 11: found "), "{message}");
    assert!(yaml("negate: 0\n", "", good).starts_with("m.yaml: negate: found nothing"));
    assert!(yaml("negate", "negative", good).starts_with("m.yaml: negate: found nothing"));
    assert!(yaml("m.pgm", "n.pgm", good).starts_with("n.pgm: file: found No such file"));
    assert!(yaml("", "", b"P5 2 1 255\n\xFE").starts_with("m.pgm: pixels: found 1 bytes, expected 2"));
    assert!(yaml("", "", b"P5 99999999 99999999 255\n").starts_with("m.pgm: size: found 99999999 by"));
    assert!(yaml("", "", b"P2 1 1 255\nx").starts_with("m.pgm: pixel: found byte 120"));
    assert!(yaml("", "", b"P2 1 1 100\n101").starts_with("m.pgm: pixel: found 101, expected at most 100"));
    assert!(yaml("", "", b"P5 1 1 65536\n\0\0").starts_with("m.pgm: maximum: found 65536"));
    assert!(yaml("", "", b"P5 2 1 65535\n\xFE\xFE").starts_with("m.pgm: pixels: found 2 bytes, expected 4"));
    assert!(yaml("", "", b"GIF89a").starts_with("m.pgm: first bytes: found something else"));
    assert!(yaml("", "", b"\x89PNG\r\n\x1a\nrubbish").starts_with("m.pgm: PNG: found"));
}

/// The scenario of a yaml beside an image.
#[track_caller]
fn grid(yaml: &[u8], image: &[u8]) -> jostle_sim::Scenario {
    let (_folder, path) = write(&[("m.yaml", yaml), ("m.pgm", image)]);
    maps::load(&path).expect("a map")
}

/// An image of free cells but for the left column.
const HALF: &[u8] = b"P5 2 2 255\n\x00\xFE\x00\xFE";

#[test]
fn the_same_map_in_other_yaml_is_the_same() {
    let expected = grid(YAML.as_bytes(), HALF);
    let same = |yaml: &[u8]| assert_eq!(grid(yaml, HALF), expected, "{}", String::from_utf8_lossy(yaml));
    let with = |from: &str, to: &str| {
        assert!(YAML.contains(from), "{from}");
        same(YAML.replace(from, to).as_bytes());
    };
    with("[-1.0, -2.0, 0.0]", "[-1.0,\n  -2.0, 0.0]");
    with("[-1.0, -2.0, 0.0]", "\n- -1.0\n- -2.0 # y\n- 0.0");
    with("[-1.0, -2.0, 0.0]", "[ -1, -2., +0e0 ]");
    for word in ["false", "False", "no", "off", "\"0\"", "0.0"] {
        with("negate: 0", &format!("negate: {word}"));
    }
    with("image: m.pgm", "image: m.pgm\t# a map");
    with("image: m.pgm", "image:\tm.pgm");
    with("negate: 0", "negate:\t\t0 \t");
    with("[-1.0, -2.0, 0.0]", "\n-\t-1.0\n- -2.0\n-\t0");
    with("image: m.pgm", "image: 'm.pgm'");
    with("image: m.pgm", "\"image\": \"m.pgm\"");
    with("image: m.pgm", "# made by hand\n---\nimage: m.pgm");
    with("image: m.pgm", "%YAML 1.2\n---\nimage: m.pgm");
    with("image: m.pgm", "image: m.pgm\nmap_id: /a/7f\nareas: {a: [1, [2]], b: ~}\ntags:\n- x\n- y: z");
    with("resolution: 0.5", "resolution: &half !!float 0.5\nhalf: *half\nmode: trinary");
    same(YAML.replace('\n', "\r\n").as_bytes());
    same(format!("{{{}}}", YAML.trim_end().replace('\n', ", ")).as_bytes());
    same(format!("\u{feff}{YAML}").as_bytes());
    let wide: Vec<u8> = format!("\u{feff}{YAML}").encode_utf16().flat_map(u16::to_le_bytes).collect();
    same(&wide);
}

#[test]
fn polygon_maps_may_begin_with_a_byte_order_mark() {
    let json = r#"{ "walls": { "min": [-10, -10], "max": [10, 10] } }"#;
    for (name, text) in [("m.toml", WALLS), ("m.json", json)] {
        let (_folder, path) = write(&[(name, format!("\u{feff}{text}").as_bytes())]);
        assert_eq!(
            maps::load(&path).expect("a map").walls,
            (Vec2::splat(-10.0), Vec2::splat(10.0)),
            "{name}"
        );
    }
}

#[test]
fn keys_that_are_not_read_are_told_in_one_line() {
    let yaml = format!("{YAML}map_id: /a/7f\n\"cost\\nmap\": {{a: 1}}\n");
    let (_folder, path) = write(&[("m.yaml", yaml.as_bytes()), ("m.pgm", HALF)]);
    let notes = maps::notes(&path).expect("notes");
    assert_eq!(notes, [format!("{}: not read: map_id, cost map", path.display())]);
    let (_folder, path) = write(&[("m.yaml", YAML.as_bytes()), ("m.pgm", HALF)]);
    assert!(maps::notes(&path).expect("notes").is_empty());
}

/// For the middles of a row of cells of half a metre, from (-0.75, -1.75) on: true if the cell is
/// free.
fn free_row(scenario: &jostle_sim::Scenario, n: u8) -> Vec<bool> {
    let world = scenario.build().expect("world");
    (0..n).map(|i| world.clearance(Vec2::new(f32::from(i) * 0.5 - 0.75, -1.75)) > 0.2).collect()
}

#[test]
fn modes_are_read_as_nav2_does() {
    let row = |mode: &str, image: &[u8], n| {
        let yaml = YAML.replace("negate", &format!("mode: {mode}\nnegate"));
        free_row(&grid(yaml.as_bytes(), image), n)
    };
    let image = b"P5 5 1 255\n\x00\x13\x1E\xCD\xFE";
    assert_eq!(row("trinary", image, 5), [false, false, false, false, true]);
    // 205 is a thousandth above the threshold: a share that rounds to 0.
    assert_eq!(row("scale", image, 5), [false, false, false, true, true]);
    // 0, 19 and 30 are percentages; 205 and 254 are none.
    assert_eq!(row("raw", image, 5), [true, true, false, false, false]);
}

#[test]
fn images_of_sixteen_bits_and_of_colours_are_read_in_full() {
    // Free is what is lighter than 1 − 0.196: 0xCDD2 / 65535 = 0.803998 is not, 0xCDD3 / 65535 =
    // 0.804013 is.
    let deep = b"P5 2 1 65535\n\xCD\xD2\xCD\xD3";
    assert_eq!(free_row(&grid(YAML.as_bytes(), deep), 2), [false, true]);
    assert_eq!(free_row(&grid(YAML.as_bytes(), b"P2 2 1 65535\n52690 52691\n"), 2), [false, true]);
    assert_eq!(free_row(&grid(YAML.as_bytes(), b"P6 2 1 255\n\xFE\xFE\x00\xFE\xFE\xFE"), 2), [false, true]);
    assert_eq!(free_row(&grid(YAML.as_bytes(), b"P3 2 1 9\n9 9 0  9 9 9"), 2), [false, true]);
    // What follows the pixels is not looked at.
    assert_eq!(free_row(&grid(YAML.as_bytes(), b"P5 2 1 255\n\x00\xFE\n"), 2), [false, true]);
    let png = |color, data: &[u8]| {
        let mut image = Vec::new();
        let mut encoder = png::Encoder::new(&mut image, 2, 1);
        encoder.set_color(color);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.write_header().expect("header").write_image_data(data).expect("pixels");
        free_row(&grid(YAML.as_bytes(), &image), 2)
    };
    assert_eq!(png(png::ColorType::Grayscale, b"\xCD\xD2\xCD\xD3"), [false, true]);
    // Half transparent white: (3 · 1 + 0.5) / 4 = 0.875 is free; a tenth: 0.775 is not.
    assert_eq!(png(png::ColorType::GrayscaleAlpha, b"\xFF\xFF\x19\x99\xFF\xFF\x80\x00"), [false, true]);
}

#[test]
fn a_yaw_turns_the_map_around_its_origin() {
    // One row of eight cells, the fourth solid, turned by 30°.
    let turned = YAML.replace("-2.0, 0.0]", "-2.0, 0.523598776]").replace("0.5", "1.0");
    let turned = turned.replace("1.023598776", "0.523598776").replace("1.023", "0.523");
    assert!(turned.contains("0.523598776") && turned.contains("resolution: 1.0"), "{turned}");
    let image = b"P5 8 3 255\n\xFE\xFE\xFE\xFE\xFE\xFE\xFE\xFE\xFE\xFE\xFE\x00\xFE\xFE\xFE\xFE\xFE\xFE\xFE\xFE\xFE\xFE\xFE\xFE";
    let world = grid(turned.as_bytes(), image).build().expect("world");
    let at = |x: f32, y: f32| {
        let point =
            Vec2::new(-1.0, -2.0) + Vec2::from_angle(std::f32::consts::FRAC_PI_6).rotate(Vec2::new(x, y));
        world.clearance(point)
    };
    assert_eq!(at(3.5, 1.5), 0.0);
    assert!((at(2.5, 1.5) - 0.5).abs() < 1e-5 && (at(3.5, 0.5) - 0.5).abs() < 1e-5);
    // The turned image's border is solid, although the walls are farther out.
    assert!((at(0.25, 1.5) - 0.25).abs() < 1e-4, "{}", at(0.25, 1.5));
    for (x, y) in [(-0.2, 1.5), (8.2, 1.5), (4.0, -0.2), (4.0, 3.2)] {
        assert_eq!(at(x, y), 0.0, "({x}, {y})");
    }
    let (min, max) = world.walls().expect("walls");
    let reach = Vec2::new(8.0 * 0.866_025_4 - 1.0, 4.0 + 3.0 * 0.866_025_4 - 2.0);
    assert!((min - Vec2::new(-2.5, -2.0)).length() < 1e-5 && (max - reach).length() < 1e-5, "{min} {max}");
}

#[test]
fn what_is_too_far_for_single_precision_is_refused_in_one_line() {
    let far = "walls = { min = [500000.0, 500000.0], max = [500020.0, 500020.0] }";
    assert!(refused(&[("m.toml", far.as_bytes())]).starts_with("m.toml: walls: found [500000, 500000]"));
    let check = |obstacle: &str| {
        let map = format!("{WALLS}[[obstacle]]\n{obstacle}\n");
        let message = refused(&[("m.toml", map.as_bytes())]);
        assert!(
            message.starts_with("m.toml: obstacle 0: found [3e6, 0]".replace("3e6", "3000000").as_str()),
            "{message}"
        );
    };
    check("circle = { centre = [3e6, 0.0], radius = 1.0 }");
    check("box = { centre = [3e6, 0.0], length = 1.0, width = 1.0 }");
    let message =
        refused(&[("m.toml", format!("{WALLS}[[obstacle]]\nsegment = [[0, 0], [2000, 0]]\n").as_bytes())]);
    assert!(message.starts_with("m.toml: obstacle 0: found [2000, 0]"), "{message}");
}

#[test]
fn degenerate_shapes_are_refused_in_one_line() {
    let check = |obstacle: &str, found: &str| {
        let map = format!("{WALLS}[[obstacle]]\n{obstacle}\n");
        let message = refused(&[("m.toml", map.as_bytes())]);
        assert!(message.starts_with(&format!("m.toml: obstacle 0{found}")), "{message}");
    };
    check("polygon = [[0, 0], [1, 0], [1, 5e-17], [1, 1], [0, 1]]", ": found 0.0000");
    check("polygon = [[0, 0], [1, 0], [2, 1e-17]]", ": found an outline that goes back on itself");
    check("polygon = [[0, 0], [1, 0], [1, 0]]", ": found 0 m from vertex 1");
    check("segment = [[1, 1], [1, 1]]", ": found [1, 1]–[1, 1]");
    check("circle = { centre = [0, 0], radius = 1e-30 }", ".radius: found");
    check("box = { centre = [0, 0], length = 1e-20, width = 1 }", ".length: found");
    check(
        "box = { centre = [nan, 0], length = 1, width = 1 }",
        ".pose: found [NaN, 0], heading 0 rad, expected finite numbers",
    );
}

#[test]
fn a_map_is_known_by_its_content() {
    let hash = |yaml: &str, image: &[u8]| {
        let (_folder, path) = write(&[("m.yaml", yaml.as_bytes()), ("m.pgm", image)]);
        maps::sha256(&path).expect("hash")
    };
    let first = hash(YAML, HALF);
    assert_eq!((first.len(), &hash(YAML, HALF)), (64, &first));
    assert_ne!(hash(&YAML.replace("0.5", "0.6"), HALF), first);
    assert_ne!(hash(YAML, b"P5 2 2 255\n\x00\xFE\x00\x00"), first);
    let (_folder, path) = write(&[("m.toml", b"")]);
    assert_eq!(
        maps::sha256(&path).expect("hash"),
        "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
    );
}
