//! The node on the network: topics in, commands out, one loop that sleeps until a message or a
//! deadline comes.
//!
//! Whatever ends the loop, zero commands come after it. A second thread publishes them where the
//! loop hangs: a policy that does not answer cannot drive on.

use std::io::{Read as _, Write as _};
use std::net::{IpAddr, Ipv4Addr};
use std::os::fd::AsRawFd as _;
use std::os::unix::net::UnixStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{
    Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, Subscription, WriteError,
};
use rustdds::DomainParticipantBuilder;
use rustdds::mio1::unix::SourceFd;
use rustdds::mio1::{Events, Interest, Poll, Token};
use serde::de::DeserializeOwned;

use crate::driver::{Command, Driver};
use crate::error::RosError;
use crate::messages::{Header, LaserScan, Odometry, PoseStamped, Time, Twist, TwistStamped, Vector3};
use crate::params::{CommandType, MAX_DOMAIN, NetworkParams, Params, Reliability};
use crate::stop::Stop;

const SIGNAL: Token = Token(0);
const SCAN: Token = Token(1);
const ODOM: Token = Token(2);
const GOAL: Token = Token(3);
/// Periods without a turn of the loop after which it is taken to hang. It turns at each beat, which
/// may come a window late.
const LONGEST: f64 = 1.75;
/// Zero commands at the end, and the time between them.
const LAST: (u32, Duration) = (3, Duration::from_millis(15));

/// Messages of one topic, counted by the numbers that their senders give them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Count {
    /// Messages that arrived.
    pub received: u64,
    /// Numbers that were left out.
    pub lost: u64,
    last: Option<(Vec<u8>, i64)>,
}

impl Count {
    fn add(&mut self, sender: Vec<u8>, number: i64) {
        self.received += 1;
        if let Some((before, last)) = &self.last
            && *before == sender
            && number > *last + 1
        {
            self.lost += (number - last - 1) as u64;
        }
        self.last = Some((sender, number));
    }
}

/// Counts of messages received and sent.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Scans.
    pub scans: Count,
    /// Odometry.
    pub odometry: Count,
    /// Goals.
    pub goals: Count,
    /// Commands that were published.
    pub commands: u64,
}

/// The node, ready to run.
pub struct RosNode {
    driver: Driver,
    scans: Subscription<LaserScan>,
    odometry: Subscription<Odometry>,
    goals: Subscription<PoseStamped>,
    out: Arc<Out>,
    /// The node keeps its topics on the network.
    _node: Node,
}

/// Publishes commands.
pub(crate) struct Out {
    commands: Commands,
    frame: String,
}

enum Commands {
    Twist(Publisher<Twist>),
    Stamped(Publisher<TwistStamped>),
}

impl Out {
    /// The publisher of commands that parameters describe.
    pub(crate) fn new(node: &mut Node, params: &Params) -> Result<Self, RosError> {
        // A command that cannot be sent at once is worth nothing later.
        let reliable = QosProfile::publisher_default()
            .reliability_reliable(WhenFull::Fail)
            .history(History::KeepLast { depth: 1 });
        let name = &params.topics.cmd;
        let commands = match params.command.kind {
            CommandType::Twist => Commands::Twist(publish(node, name, "Twist", &reliable)?),
            CommandType::TwistStamped => Commands::Stamped(publish(node, name, "TwistStamped", &reliable)?),
        };
        Ok(Self { commands, frame: params.command.frame.clone() })
    }

    /// Publishes the last command, some times.
    pub(crate) fn last(&self, command: &Command) -> Result<(), RosError> {
        for _ in 0..LAST.0 {
            let sent = self.publish(command);
            std::thread::sleep(LAST.1);
            sent?;
        }
        Ok(())
    }

    pub(crate) fn publish(&self, command: &Command) -> Result<(), RosError> {
        let linear = Vector3 { x: command.v, ..Vector3::default() };
        let angular = Vector3 { z: command.w, ..Vector3::default() };
        let twist = Twist { linear, angular };
        match &self.commands {
            Commands::Twist(publisher) => sent(publisher.publish(twist)),
            Commands::Stamped(publisher) => {
                let header = Header { stamp: command.stamp, frame_id: self.frame.clone() };
                sent(publisher.publish(TwistStamped { header, twist }))
            }
        }
    }
}

/// A subscriber that is dead or asleep may leave no room for a command; the next one follows within
/// a period.
fn sent<M>(result: Result<(), WriteError<M>>) -> Result<(), RosError> {
    match result {
        Ok(()) | Err(WriteError::WouldBlock { .. }) => Ok(()),
        Err(error) => Err(RosError::transport("publish a command")(error)),
    }
}

/// Lets the second thread see whether the loop still turns.
#[derive(Default)]
struct Pulse {
    /// Milliseconds after the start.
    last: AtomicU64,
    driving: AtomicBool,
    ended: AtomicBool,
}

impl RosNode {
    /// Joins the network.
    ///
    /// # Errors
    ///
    /// Names that are none; variables of ROS that are not what they may be; a transport that cannot
    /// be had.
    pub fn new(driver: Driver, params: &Params) -> Result<Self, RosError> {
        let mut node = join(&params.network, &params.network.name)?;
        let qos = |reliability, latched| {
            let base = QosProfile::subscription_default().history(History::KeepLast { depth: 1 });
            let base = if latched { base.durability(Durability::TransientLocal) } else { base };
            match reliability {
                Reliability::BestEffort => base.reliability_best_effort(),
                Reliability::Reliable => base.reliability_reliable(WhenFull::DEFAULT),
            }
        };
        let (topics, q) = (&params.topics, &params.qos);
        let scans = subscribe(&mut node, &topics.scan, ("sensor_msgs", "LaserScan"), &qos(q.scan, false))?;
        let odometry = subscribe(&mut node, &topics.odom, ("nav_msgs", "Odometry"), &qos(q.odom, false))?;
        let goal_type = ("geometry_msgs", "PoseStamped");
        let goals = subscribe(&mut node, &topics.goal, goal_type, &qos(q.goal, q.goal_latched))?;
        let out = Arc::new(Out::new(&mut node, params)?);
        Ok(Self { driver, scans, odometry, goals, out, _node: node })
    }

    /// Drives until something asks for an end; `report` hears why the robot stands, or that it
    /// drives (`None`), whenever that changes. The last commands are zero, whatever ends it.
    ///
    /// # Errors
    ///
    /// The transport fails, or the policy panicked.
    pub fn run(
        mut self,
        ends: &mut Ends,
        mut report: impl FnMut(Option<&Stop>),
    ) -> Result<Traffic, RosError> {
        let pulse = Arc::new(Pulse::default());
        let started = Instant::now();
        let out = Arc::clone(&self.out);
        let watch = watch(Arc::clone(&pulse), started, self.driver.period(), move || {
            let zero = Command { v: 0.0, w: 0.0, stamp: Time::default(), stop: Some(Stop::Exit) };
            // The loop's own publishing tells of a transport that fails.
            let _ = out.publish(&zero);
        });
        let mut traffic = Traffic::default();
        let ended =
            catch_unwind(AssertUnwindSafe(|| self.turn(started, &pulse, &mut traffic, ends, &mut report)));
        pulse.ended.store(true, Ordering::SeqCst);
        self.out.last(&self.driver.zero(started.elapsed().as_secs_f64(), Stop::Exit))?;
        report(Some(&Stop::Exit));
        let _ = watch.join();
        match ended {
            Ok(result) => result.map(|()| traffic),
            Err(_) => Err(RosError::Panic { reason: "the loop of the node ended".to_owned() }),
        }
    }

    /// The loop.
    fn turn(
        &mut self,
        started: Instant,
        pulse: &Pulse,
        traffic: &mut Traffic,
        ends: &mut Ends,
        report: &mut impl FnMut(Option<&Stop>),
    ) -> Result<(), RosError> {
        let mut poll = Poll::new().map_err(RosError::transport("wait for messages"))?;
        let mut signals = Events::with_capacity(16);
        self.register(&poll, ends)?;
        let mut told: Option<Option<Stop>> = None;
        loop {
            let now = started.elapsed().as_secs_f64();
            self.take(now, traffic);
            if let Some(command) = self.driver.step(now) {
                self.out.publish(&command)?;
                traffic.commands += 1;
                pulse.driving.store(command.v != 0.0 || command.w != 0.0, Ordering::SeqCst);
                if told.as_ref() != Some(&command.stop) {
                    report(command.stop.as_ref());
                    told = Some(command.stop);
                }
            }
            if let Some(reason) = self.driver.panicked() {
                return Err(RosError::Panic { reason: reason.to_owned() });
            }
            pulse.last.store(started.elapsed().as_millis() as u64, Ordering::SeqCst);
            let wait = (self.driver.deadline() - started.elapsed().as_secs_f64()).clamp(0.0, 1.0);
            // The system waits in whole milliseconds, and rather too long than too short.
            let wait = Duration::from_secs_f64(wait);
            match poll.poll(&mut signals, Some(wait)) {
                Ok(()) => {}
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => return Err(RosError::transport("wait for messages")(error)),
            }
            if signals.iter().any(|event| event.token() == SIGNAL) {
                return Ok(());
            }
        }
    }

    fn register(&mut self, poll: &Poll, ends: &Ends) -> Result<(), RosError> {
        let failed = || RosError::transport("wait for messages");
        let registry = poll.registry();
        registry
            .register(&mut SourceFd(&ends.read.as_raw_fd()), SIGNAL, Interest::READABLE)
            .map_err(failed())?;
        registry.register(&mut self.scans, SCAN, Interest::READABLE).map_err(failed())?;
        registry.register(&mut self.odometry, ODOM, Interest::READABLE).map_err(failed())?;
        registry.register(&mut self.goals, GOAL, Interest::READABLE).map_err(failed())
    }

    /// Takes everything that has arrived: registrations tell of the first message only.
    fn take(&mut self, now: f64, traffic: &mut Traffic) {
        let driver = &mut self.driver;
        // Odometry first, so that a scan is answered with the pose that belongs to it.
        take_all(&self.odometry, &mut traffic.odometry, |odometry| driver.odometry(now, &odometry));
        take_all(&self.goals, &mut traffic.goals, |goal| driver.goal(now, &goal));
        take_all(&self.scans, &mut traffic.scans, |scan| driver.scan(now, &scan));
    }
}

/// Hands over all messages of a topic. One that cannot be decoded is of another definition, and
/// counts as none: what is missing becomes stale.
fn take_all<M: 'static + DeserializeOwned>(
    topic: &Subscription<M>,
    count: &mut Count,
    mut with: impl FnMut(M),
) {
    loop {
        match topic.take() {
            Ok(Some((message, info))) => {
                count.add(format!("{:?}", info.publisher_gid()).into_bytes(), info.sequence_number());
                with(message);
            }
            Ok(None) => return,
            Err(_) => {}
        }
    }
}

/// Calls `stop` again and again while the loop hangs and the robot drives.
fn watch(
    pulse: Arc<Pulse>,
    started: Instant,
    period: f64,
    stop: impl Fn() + Send + 'static,
) -> std::thread::JoinHandle<()> {
    let pause = Duration::from_secs_f64(period / 4.0);
    let longest = Duration::from_secs_f64(LONGEST * period).as_millis() as u64;
    std::thread::spawn(move || {
        while !pulse.ended.load(Ordering::SeqCst) {
            std::thread::sleep(pause);
            let now = started.elapsed().as_millis() as u64;
            let silent = now.saturating_sub(pulse.last.load(Ordering::SeqCst));
            if silent > longest && pulse.driving.load(Ordering::SeqCst) {
                stop();
            }
        }
    })
}

/// Becomes readable when something asks for an end: SIGINT, SIGTERM, or what else is added.
pub struct Ends {
    read: UnixStream,
    write: UnixStream,
}

impl Ends {
    /// Listens to the signals.
    ///
    /// # Errors
    ///
    /// The system has no file for it.
    pub fn new() -> Result<Self, RosError> {
        let failed = || RosError::transport("listen to signals");
        let (read, write) = UnixStream::pair().map_err(failed())?;
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            let write = write.try_clone().map_err(failed())?;
            signal_hook::low_level::pipe::register(signal, write).map_err(failed())?;
        }
        Ok(Self { read, write })
    }

    /// The end of standard input asks for an end, too.
    ///
    /// # Errors
    ///
    /// The system has no file for it.
    pub fn with_standard_input(self) -> Result<Self, RosError> {
        let mut write = self.write.try_clone().map_err(RosError::transport("listen to standard input"))?;
        std::thread::spawn(move || {
            let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
            // If nobody reads any more, the loop has ended.
            let _ = write.write_all(&[0]);
        });
        Ok(self)
    }

    /// Waits.
    pub(crate) fn wait(&mut self) {
        // An error ends as a signal does.
        let _ = self.read.read(&mut [0; 1]);
    }
}

/// A node in the domain and on the interfaces that parameters or ROS' own variables name.
pub(crate) fn join(params: &NetworkParams, name: &str) -> Result<Node, RosError> {
    let variable = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    let domain = match params.domain {
        Some(domain) => domain,
        None => domain(variable("ROS_DOMAIN_ID").as_deref())?,
    };
    let interfaces = interfaces(
        &params.interfaces,
        variable("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref(),
        variable("ROS_LOCALHOST_ONLY").as_deref(),
    )?;
    let mut builder = DomainParticipantBuilder::new(domain);
    if !interfaces.is_empty() {
        builder = builder.with_only_networks(interfaces);
    }
    let failed = "join the network";
    let participant = builder.build().map_err(RosError::transport(failed))?;
    let context = Context::from_domain_participant(participant).map_err(RosError::transport(failed))?;
    let name =
        NodeName::new(&params.namespace, name).map_err(|error| topic_error(name, &format!("{error:?}")))?;
    let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
    context.new_node(name, options).map_err(RosError::transport(failed))
}

/// The domain that `ROS_DOMAIN_ID` means.
fn domain(variable: Option<&str>) -> Result<u16, RosError> {
    let Some(text) = variable else { return Ok(0) };
    text.parse().ok().filter(|domain| *domain <= MAX_DOMAIN).ok_or_else(|| RosError::Environment {
        name: "ROS_DOMAIN_ID",
        found: text.to_owned(),
        expected: "an integer in [0, 232]",
    })
}

/// The addresses to use; none means all.
fn interfaces(
    named: &[IpAddr],
    range: Option<&str>,
    localhost_only: Option<&str>,
) -> Result<Vec<IpAddr>, RosError> {
    let loopback = || vec![IpAddr::V4(Ipv4Addr::LOCALHOST)];
    if !named.is_empty() {
        return Ok(named.to_vec());
    }
    match range {
        Some("LOCALHOST") => return Ok(loopback()),
        Some("SUBNET" | "SYSTEM_DEFAULT") | None => {}
        Some(other) => {
            return Err(RosError::Environment {
                name: "ROS_AUTOMATIC_DISCOVERY_RANGE",
                found: other.to_owned(),
                expected: "SUBNET, LOCALHOST or SYSTEM_DEFAULT",
            });
        }
    }
    Ok(if range.is_none() && localhost_only == Some("1") { loopback() } else { Vec::new() })
}

fn subscribe<M: 'static>(
    node: &mut Node,
    name: &str,
    (package, message): (&str, &str),
    qos: &QosProfile,
) -> Result<Subscription<M>, RosError> {
    let topic = topic(node, name, MessageTypeName::new(package, message), qos)?;
    node.create_subscription(&topic, None).map_err(RosError::transport("subscribe"))
}

fn publish<M: serde::Serialize>(
    node: &mut Node,
    name: &str,
    message: &str,
    qos: &QosProfile,
) -> Result<Publisher<M>, RosError> {
    let topic = topic(node, name, MessageTypeName::new("geometry_msgs", message), qos)?;
    node.create_publisher(&topic, None).map_err(RosError::transport("publish"))
}

fn topic(
    node: &Node,
    name: &str,
    message: MessageTypeName,
    qos: &QosProfile,
) -> Result<rustdds::Topic, RosError> {
    let parsed = Name::parse(name).map_err(|error| topic_error(name, &format!("{error:?}")))?;
    node.create_topic(&parsed, message, qos).map_err(RosError::transport("create a topic"))
}

fn topic_error(name: &str, problem: &str) -> RosError {
    RosError::Topic { name: name.to_owned(), problem: problem.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variables_of_ros_are_heeded() {
        assert_eq!(domain(None).unwrap(), 0);
        assert_eq!(domain(Some("42")).unwrap(), 42);
        let message = domain(Some("233")).unwrap_err().to_string();
        assert_eq!(message, "ROS_DOMAIN_ID: found 233, expected an integer in [0, 232]");
        let loopback: IpAddr = "127.0.0.1".parse().unwrap();
        let of = |range, only| interfaces(&[], range, only).unwrap();
        assert_eq!(of(Some("LOCALHOST"), None), [loopback]);
        assert_eq!(of(None, Some("1")), [loopback]);
        assert!(of(None, None).is_empty() && of(Some("SUBNET"), Some("1")).is_empty());
        let named: IpAddr = "192.168.1.2".parse().unwrap();
        assert_eq!(interfaces(&[named], Some("LOCALHOST"), None).unwrap(), [named]);
        assert!(interfaces(&[], Some("OFF"), None).unwrap_err().to_string().contains("found OFF"));
    }

    #[test]
    fn a_loop_that_hangs_while_the_robot_drives_is_a_stop() {
        let (calls, stops) = std::sync::mpsc::channel();
        let pulse = Arc::new(Pulse::default());
        let started = Instant::now();
        let watch = watch(Arc::clone(&pulse), started, 0.04, move || {
            let _ = calls.send(());
        });
        // It stands: nothing has to be stopped.
        assert!(stops.recv_timeout(Duration::from_millis(200)).is_err());
        pulse.driving.store(true, Ordering::SeqCst);
        assert!(stops.recv_timeout(Duration::from_secs(5)).is_ok());
        // It turns.
        let millis = started.elapsed().as_millis() as u64;
        pulse.last.store(millis + 3_600_000, Ordering::SeqCst);
        while stops.recv_timeout(Duration::from_millis(200)).is_ok() {}
        pulse.ended.store(true, Ordering::SeqCst);
        watch.join().unwrap();
    }

    #[test]
    fn gaps_in_the_senders_numbers_are_losses() {
        let mut count = Count::default();
        for (sender, number) in [(1, 5), (1, 6), (1, 9), (2, 1), (2, 2), (2, 2)] {
            count.add(vec![sender], number);
        }
        assert_eq!((count.received, count.lost), (6, 2));
    }
}
