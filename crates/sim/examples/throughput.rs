//! Agent-steps per second on one thread: whole steps with motion, 512 noisy beams and observation
//! writing.
//!
//! `cargo run --release -p jostle-sim --example throughput` prints N = 5, N = 20 and N = 5 with 50
//! polygons, alternating between the cases, with the median of the rounds.

use glam::Vec2;
use jostle_sim::{LaserKernel, Rooms, SimConfig, Streams};
use std::fmt::Write;
use std::time::Instant;

/// Seconds that this thread has computed; where the system does not tell (it is not Linux), seconds
/// on the clock. A machine that is busy with other work then does not distort the figures.
fn seconds(start: Instant) -> f64 {
    let on_cpu = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let on_cpu = on_cpu.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    on_cpu.map_or_else(|| start.elapsed().as_secs_f64(), |nanoseconds| nanoseconds * 1e-9)
}

/// Fifty polygons of three to seven sides on a grid with room between them, as a map file's text.
fn polygons() -> String {
    let mut text = String::from("[walls]\nmin = [-20.0, -20.0]\nmax = [20.0, 20.0]\n");
    for i in 0..50_u8 {
        let centre = Vec2::new(f32::from(i % 10) * 3.6 - 16.2, f32::from(i / 10) * 7.0 - 14.0);
        let sides = 3 + i % 5;
        let corner = |k: u8| {
            let angle = f32::from(i) + f32::from(k) * std::f32::consts::TAU / f32::from(sides);
            let corner = centre + 0.4 * Vec2::from_angle(angle);
            format!("[{:.4}, {:.4}]", corner.x, corner.y)
        };
        let corners: Vec<String> = (0..sides).map(corner).collect();
        writeln!(text, "[[obstacle]]\npolygon = [{}]", corners.join(", ")).expect("a string grows");
    }
    text
}

/// Steps all rooms for about 0.2 s; agent-steps per second.
fn measure(rooms: &mut Rooms, step: &mut u32) -> f64 {
    let (clock, mut n) = (Instant::now(), 0);
    let start = seconds(clock);
    let mut now = start;
    while now - start < 0.2 {
        for _ in 0..20 {
            let turn = f32::sin(*step as f32 * 0.05);
            let actions: Vec<[f32; 2]> = (0..rooms.len()).map(|i| [0.7, turn * (i % 3) as f32]).collect();
            rooms.step(&actions);
            n += rooms.len();
            *step += 1;
        }
        now = seconds(clock);
    }
    n as f64 / (now - start)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| run().map_err(|error| error.to_string()))?;
    Ok(())
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let map = std::env::temp_dir().join(format!("throughput-{}.toml", std::process::id()));
    std::fs::write(&map, polygons())?;
    let with = |n_agents: usize, polygons: bool, kernel: LaserKernel| {
        let mut config = SimConfig::default();
        config.laser.kernel = kernel;
        config.room.map = polygons.then(|| map.clone());
        Rooms::new(&config, 8, n_agents, 5, &Streams::new(1))
    };
    let mut cases = [
        ("N = 5", with(5, false, LaserKernel::Analytic)?),
        ("N = 20", with(20, false, LaserKernel::Analytic)?),
        ("N = 5, 50 polygons", with(5, true, LaserKernel::Analytic)?),
        ("N = 5, parry kernel", with(5, false, LaserKernel::Parry)?),
    ];
    std::fs::remove_file(&map)?;
    let mut rates = vec![Vec::new(); cases.len()];
    let mut step = 0;
    for _ in 0..7 {
        for ((_, rooms), rates) in cases.iter_mut().zip(&mut rates) {
            rates.push(measure(rooms, &mut step));
        }
    }
    for ((name, _), rates) in cases.iter().zip(&mut rates) {
        rates.sort_by(f64::total_cmp);
        println!("{name:<22}{:>9.0} agent-steps/s (least {:.0}, most {:.0})", rates[3], rates[0], rates[6]);
    }
    Ok(())
}
