//! `jostle-ros`: a policy drives a ROS 2 robot.

#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use jostle_ros::node::{Count, Ends, RosNode, Traffic};
use jostle_ros::params::DEFAULTS;
use jostle_ros::{Driver, Params, RosError, guard, policy};

/// Drive a ROS 2 robot by a policy: scan, odometry and goal in, velocity commands out.
#[derive(Parser)]
#[expect(clippy::doc_markdown, reason = "these comments are the help, where backticks would be noise")]
#[command(
    name = "jostle-ros",
    version,
    after_help = "Examples:\n  jostle-ros --policy checkpoints/strong-seed1-002035.safetensors --scan /scan --odom /odom --goal /goal --cmd /cmd_vel\n  \
    jostle-ros --policy dwa --params robot.toml\n  jostle-ros --print-params > robot.toml\n\n\
    The robot stands unless the last scan, the last odometry and the goal are there, young and valid; Ctrl-C and SIGTERM stop it.\n\
    ROS_DOMAIN_ID, ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_LOCALHOST_ONLY are heeded. docs/how-to-ros2.md says more."
)]
struct Arguments {
    /// A checkpoint file, a run folder, or a planner's name (dwa, goal-seeker, brake, straight)
    #[arg(long, required_unless_present = "print_params")]
    policy: Option<PathBuf>,
    /// Topic of the scans (sensor_msgs/LaserScan); default /scan
    #[arg(long)]
    scan: Option<String>,
    /// Topic of the odometry (nav_msgs/Odometry); default /odom
    #[arg(long)]
    odom: Option<String>,
    /// Topic of the goals (geometry_msgs/PoseStamped); default /goal_pose
    #[arg(long)]
    goal: Option<String>,
    /// Topic of the commands (geometry_msgs/Twist or TwistStamped); default /cmd_vel
    #[arg(long)]
    cmd: Option<String>,
    /// Behaviour token of the policy
    #[arg(long, default_value_t = 0)]
    token: u32,
    /// Parameters (TOML); an option of the command line goes before the file's
    #[arg(long)]
    params: Option<PathBuf>,
    /// Drive in this process, without a second one that commands zero where this one is killed
    #[arg(long)]
    no_guard: bool,
    /// Drive in this process until standard input ends: how the guarding process starts this one
    #[arg(long, hide = true)]
    guarded: bool,
    /// Print all parameters with what they mean, at their defaults, and end
    #[arg(long)]
    print_params: bool,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if arguments.print_params {
        print!("{DEFAULTS}");
        return ExitCode::SUCCESS;
    }
    match run(arguments) {
        Ok(Some(traffic)) => {
            eprintln!("jostle-ros: {}", in_words(&traffic));
            ExitCode::SUCCESS
        }
        Ok(None) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Drives; `None` if another process did and this one guarded it.
fn run(arguments: Arguments) -> Result<Option<Traffic>, RosError> {
    let mut params = arguments.params.as_deref().map_or_else(|| Ok(Params::default()), Params::load)?;
    let topics = &mut params.topics;
    for (topic, option) in [
        (&mut topics.scan, arguments.scan),
        (&mut topics.odom, arguments.odom),
        (&mut topics.goal, arguments.goal),
        (&mut topics.cmd, arguments.cmd),
    ] {
        if let Some(name) = option {
            *topic = name;
        }
    }
    // clap has seen to it that there is one.
    let path = arguments.policy.unwrap_or_default();
    let chosen = policy::choose(&path, arguments.token)?;
    let ends = Ends::new()?;
    if !arguments.guarded && !arguments.no_guard {
        guard::run(ends, &params, f64::from(chosen.sim.episode.dt))?;
        return Ok(None);
    }
    let mut ends = if arguments.guarded { ends.with_standard_input()? } else { ends };
    let topics = &params.topics;
    eprintln!(
        "jostle-ros: {} reads {}, {} and {}, commands {} every {} s",
        chosen.name, topics.scan, topics.odom, topics.goal, topics.cmd, chosen.sim.episode.dt
    );
    let driver = Driver::new(chosen.policy, &chosen.sim, params.clone());
    let traffic = RosNode::new(driver, &params)?.run(&mut ends, |stop| match stop {
        Some(stop) => eprintln!("jostle-ros: stands: {stop}"),
        None => eprintln!("jostle-ros: drives"),
    })?;
    Ok(Some(traffic))
}

/// The traffic, in a line.
fn in_words(traffic: &Traffic) -> String {
    let of = |count: &Count, name: &str| format!("{} {name} ({} lost)", count.received, count.lost);
    format!(
        "received {}, {}, {}; published {} commands",
        of(&traffic.scans, "scans"),
        of(&traffic.odometry, "odometry"),
        of(&traffic.goals, "goals"),
        traffic.commands
    )
}
