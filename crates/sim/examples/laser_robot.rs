//! One robot in a room with an obstacle: it drives ahead and turns away from what its laser sees.
//!
//! `cargo run --release -p jostle-sim --example laser_robot`

use glam::Vec2;
use jostle_sim::{Laser, LaserConfig, Motion, Pose, Sensor, Shape, SimError, World};

fn main() -> Result<(), SimError> {
    let mut world = World::new();
    world.set_walls(Vec2::splat(-5.0), Vec2::splat(5.0))?;
    world.add_obstacle(&Shape::Circle { radius: 0.6 }, Pose::new(Vec2::new(2.0, 0.2), 0.0))?;
    let robot = world.add_body(&Shape::square(0.5), Pose::default())?;

    let mut laser = Laser::new(&LaserConfig::default())?;
    let mut ranges = vec![0.0; 512];
    let mut stalled = [false];
    for step in 0..100 {
        let scan = laser.scan(&world, Sensor::Body(robot), |_| true, &mut ranges);
        let ahead = ranges[..32].iter().chain(&ranges[480..]).copied().fold(10.0, f32::min);
        let motion =
            if ahead < 1.0 { Motion::Drive { v: 0.2, w: 1.0 } } else { Motion::Drive { v: 1.0, w: 0.0 } };
        world.advance(&[motion], 0.1, &mut stalled);
        if step % 10 == 0 {
            let pose = world.pose(robot);
            println!("{step:3}: at {}, {:.2} m to {:?}", pose.position, scan.min_range, scan.nearest);
        }
    }
    Ok(())
}
