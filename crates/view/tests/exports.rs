//! What `replay` writes beside the page is made of the same episodes: an MCAP file of their exact
//! values, a GIF of their pictures.

use glam::Vec2;
use jostle_arena::Planner;
use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::Pools;
use jostle_arena::replay::EpisodeTrace;
use jostle_arena::room::RoomPlan;
use jostle_arena::site::polygons;
use jostle_eval::protocol::Protocol;
use jostle_mcap::messages::{LaserScan, MarkerArray, Odometry, TfMessage};
use jostle_peds::CrowdKind;
use jostle_view::replay::driver::Driver;
use jostle_view::replay::{Recorded, Wish, gif, mcap as recording, record};

/// Two robots in three short episodes.
fn recorded(beams: usize) -> (Protocol, [Driver; 2], Recorded) {
    let mut config = ArenaConfig::default();
    config.sim.episode.step_limit = 45;
    let protocol = Protocol::new(config, Pools::default()).unwrap();
    let drivers = [Driver::planner(Planner::Dwa), Driver::planner(Planner::Straight)];
    let wish = Wish { pick: vec![0, 4, 9], beams, ..Wish::first(1) };
    let recorded = record(&protocol, &drivers, &[CrowdKind::Sf], &wish).unwrap();
    (protocol, drivers, recorded)
}

fn site(protocol: &Protocol) -> Vec<Vec<Vec2>> {
    polygons(&RoomPlan::new(protocol.config(), CrowdKind::Sf).unwrap().scenario)
}

/// The messages of a topic, in their order.
fn read<M: serde::de::DeserializeOwned>(file: &[u8], topic: &str) -> Vec<M> {
    let messages = ::mcap::MessageStream::new(file).unwrap().map(Result::unwrap);
    let of_topic = messages.filter(|message| message.channel.topic == topic);
    of_topic
        .map(|message| cdr_encoding::from_bytes::<M, byteorder::LittleEndian>(&message.data[4..]).unwrap().0)
        .collect()
}

#[test]
fn a_recording_holds_the_exact_values_of_the_episodes() {
    let (protocol, drivers, recorded) = recorded(usize::MAX);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episodes.mcap");
    let runs: Vec<(&str, &EpisodeTrace)> = recorded.runs(&drivers).flatten().collect();
    recording::write(&path, &runs, protocol.config(), &site(&protocol)).unwrap();
    let file = std::fs::read(&path).unwrap();
    // Each episode of the first driver, then of the second.
    let names: Vec<(&str, u64)> = runs.iter().map(|(name, trace)| (*name, trace.finished.episode)).collect();
    assert_eq!(
        names,
        [("dwa", 0), ("straight", 0), ("dwa", 4), ("straight", 4), ("dwa", 9), ("straight", 9)]
    );
    let frames: Vec<_> = runs.iter().flat_map(|(_, trace)| &trace.frames).collect();

    let scans: Vec<LaserScan> = read(&file, "/scan");
    assert_eq!(scans.len(), frames.len());
    let mut partial = 0;
    for (scan, frame) in scans.iter().zip(&frames) {
        assert_eq!((scan.ranges.len(), frame.ranges.len()), (512, 512));
        for (written, range) in scan.ranges.iter().zip(&frame.ranges) {
            let expected = if *range < 10.0 { *range } else { f32::INFINITY };
            assert_eq!(written.to_bits(), expected.to_bits());
            partial += usize::from(*range < 10.0 && (range * 25.5).fract() != 0.0);
        }
    }
    assert!(partial > 10_000, "{partial} ranges are no multiple of a byte's step");

    let odometry: Vec<Odometry> = read(&file, "/odom");
    let transforms: Vec<TfMessage> = read(&file, "/tf");
    let markers: Vec<MarkerArray> = read(&file, "/markers");
    for (((odometry, transforms), markers), frame) in
        odometry.iter().zip(transforms).zip(markers).zip(&frames)
    {
        let (place, moved) = (odometry.pose.position, odometry.twist);
        assert_eq!([place.x, place.y], frame.robot.position.to_array().map(f64::from));
        assert_eq!([moved.linear.x, moved.angular.z], frame.velocity.map(f64::from));
        let turned = odometry.pose.orientation;
        let heading = 2.0 * turned.z.atan2(turned.w);
        assert!((heading - f64::from(frame.robot.heading)).abs() < 1e-12);
        assert_eq!(transforms.transforms[0].transform.translation, place);
        let of = |ns: &str| -> Vec<[f64; 2]> {
            let named = markers.markers.iter().filter(|marker| marker.ns == ns);
            named.map(|marker| [marker.pose.position.x, marker.pose.position.y]).collect()
        };
        assert_eq!(of("goal"), [frame.robot.goal.to_array().map(f64::from)]);
        let walkers = frame.pedestrians.iter().map(|walker| walker.position.to_array().map(f64::from));
        assert_eq!(of("pedestrians"), walkers.collect::<Vec<_>>());
    }
}

#[test]
fn a_page_is_the_same_whatever_its_traces_keep() {
    let [page, exact] = [128, usize::MAX].map(|beams| recorded(beams).2.page.html().unwrap());
    assert_eq!(page.len(), exact.len());
    assert!(page == exact, "a page of exact traces is another");
}

#[test]
fn a_moving_picture_is_small_and_shows_both_robots_to_their_end() {
    let (protocol, drivers, recorded) = recorded(128);
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str| {
        let path = folder.path().join(name);
        let runs = recorded.runs(&drivers).nth(1).unwrap();
        gif::write(&path, &runs, protocol.config(), &site(&protocol)).unwrap();
        std::fs::read(&path).unwrap()
    };
    let bytes = write("one.gif");
    assert!(bytes == write("two.gif"), "the same episode is the same file");
    // 4.5 s; 20 s may have a megabyte.
    assert!(bytes.len() < 200_000, "{} bytes", bytes.len());
    let mut options = ::gif::DecodeOptions::new();
    options.set_color_output(::gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(&bytes[..]).unwrap();
    let (width, height) = (usize::from(decoder.width()), usize::from(decoder.height()));
    let mut screen = vec![[0; 4]; width * height];
    let mut delays = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        delays.push(frame.delay);
        for (k, pixel) in frame.buffer.chunks_exact(4).enumerate() {
            let (row, column) = (k / usize::from(frame.width), k % usize::from(frame.width));
            if pixel[3] > 0 {
                let at = (usize::from(frame.top) + row) * width + usize::from(frame.left) + column;
                screen[at].copy_from_slice(pixel);
            }
        }
    }
    let runs = recorded.runs(&drivers).nth(1).unwrap();
    let steps = runs.iter().map(|(_, trace)| trace.frames.len() - 1).max().unwrap();
    assert_eq!(delays.len(), steps.div_ceil(2) + 1);
    assert!(delays[..delays.len() - 1].iter().all(|delay| *delay == 10) && delays[delays.len() - 1] == 150);
    // Where each robot ended its own colour is seen: the page's first and second.
    let scale = 400.0 / 20.7;
    for (k, (_, trace)) in runs.iter().enumerate() {
        let end = trace.frames.last().unwrap().robot.position;
        let x = 6.0 + k as f32 * 406.0 + (end.x + 10.35) * scale;
        let y = 6.0 + 20.0 + (10.35 - end.y) * scale;
        let [red, green, blue, _] = screen[y as usize * width + x as usize].map(i32::from);
        let [r, g, b] = [[0x25, 0x63, 0xeb], [0xc2, 0x57, 0x0c]][k];
        let off = (red - r).abs().max((green - g).abs()).max((blue - b).abs());
        assert!(off < 16, "robot {k}: #{red:02x}{green:02x}{blue:02x}");
    }
}
