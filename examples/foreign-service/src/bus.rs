//! The end of the bus at this rank: requests to the coupler, payloads to and from other ranks.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::mpsc::{channel, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex};
use std::thread::{sleep, spawn, JoinHandle};
use std::time::{Duration, Instant};

use serde_json::{json, Value};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::{Config, Session, Wait};

use crate::failure::Failure;

pub const ROLE: &str = "continuum";
const ME: &str = "continuum/0";

const UNASKED: [u8; 16] = [0; 16];
const LARGEST: usize = 256 << 20;
/// Time after which a broken connection counts as lost.
const RECONNECT: Duration = Duration::from_secs(2);
/// Time after which a request without an answer is sent again.
const REPEAT: Duration = Duration::from_secs(5);

type Result<T> = std::result::Result<T, Failure>;
type Number = [u8; 16];

/// What arrives.
pub enum Event {
    /// A frame of the coupler.
    Answer(Vec<u8>),
    /// A frame of the rank with this name.
    Payload(String, Vec<u8>),
    /// The connection broke and has come back: what was sent meanwhile is lost.
    Reconnected,
}

/// What Zenoh's thread puts into the queue.
enum Arrival {
    Answer(Number, Vec<u8>),
    Payload(String, Vec<u8>),
    /// Whether the coupler subscribes to our requests.
    Coupler(bool),
}

struct Pending {
    kind: &'static str,
    frame: Vec<u8>,
    number: Number,
    sent: Instant,
}

pub struct Bus {
    session: Session,
    start: String,
    endpoint: String,
    process: [u8; 8],
    asked: u64,
    pending: Option<Pending>,
    arrivals: (Sender<Arrival>, Receiver<Arrival>),
    requests: BTreeMap<&'static str, Publisher<'static>>,
    payloads: Arc<Publisher<'static>>,
    kept: Arc<Mutex<BTreeMap<i64, Vec<u8>>>>,
    /// Steps whose payload is to be sent again; None ends the thread.
    wanted: Sender<Option<i64>>,
    repeater: JoinHandle<()>,
    subscribers: Vec<Subscriber<()>>,
    token: LivelinessToken,
    lost_at: Option<Instant>,
}

impl Bus {
    /// Open the session and declare what belongs to a rank: first the subscribers, then the token.
    pub fn open(endpoint: &str, run: &str, keys: &Path, patience: f64) -> Result<Bus> {
        let config = settings(endpoint, keys, patience)?;
        let session = zenoh::open(config).wait().map_err(|e| {
            Failure::Lost(format!("no coupler at {endpoint} within {patience} s: {e}"))
        })?;
        let start = format!("gimpmd/{run}");
        let arrivals = channel();
        let (wanted, steps) = channel();

        let queue = arrivals.0.clone();
        let answers =
            session.declare_subscriber(format!("{start}/answer/{ME}")).callback(move |sample| {
                let number =
                    sample.attachment().and_then(|a| Number::try_from(&*a.to_bytes()).ok());
                if let Some(number) = number {
                    let _ = queue.send(Arrival::Answer(number, sample.payload().to_bytes().into()));
                }
            });
        let queue = wanted.clone();
        let again =
            session.declare_subscriber(format!("{start}/again/{ME}")).callback(move |sample| {
                let step = sample.payload().to_bytes().get(..8).map(|b| b.try_into().unwrap());
                if let Some(step) = step {
                    let _ = queue.send(Some(i64::from_le_bytes(step)));
                }
            });
        let subscribers = vec![answers.wait().map_err(trouble)?, again.wait().map_err(trouble)?];
        let token = session.liveliness().declare_token(format!("{start}/alive/{ME}"));
        let token = token.wait().map_err(trouble)?;

        let publisher = |kind: &str| {
            session
                .declare_publisher(format!("{start}/{kind}/{ME}"))
                .congestion_control(CongestionControl::Drop)
                .express(true)
                .wait()
                .map_err(trouble)
        };
        let mut requests = BTreeMap::new();
        for kind in ["register", "report", "failed"] {
            requests.insert(kind, publisher(kind)?);
        }
        let payloads = Arc::new(publisher("data")?);
        let kept = Arc::new(Mutex::new(BTreeMap::<i64, Vec<u8>>::new()));
        let queue = arrivals.0.clone();
        let watch = move |matching| {
            let _ = queue.send(Arrival::Coupler(matching));
        };
        on_matching(&requests["report"], watch)?;
        let (queue, last) = (wanted.clone(), kept.clone());
        on_matching(&payloads, move |matching| {
            let kept = last.lock().unwrap();
            for step in kept.keys().rev().take(if matching { 2 } else { 0 }) {
                let _ = queue.send(Some(*step));
            }
        })?;
        let (takers, frames) = (payloads.clone(), kept.clone());
        let repeater = spawn(move || {
            while let Ok(Some(step)) = steps.recv() {
                let frame = frames.lock().unwrap().get(&step).cloned();
                if let Some(frame) = frame {
                    // if it is lost once more, it is asked for once more
                    let _ = takers.put(frame).wait();
                }
            }
        });
        let mut process = [0; 8];
        let random = fs::File::open("/dev/urandom").and_then(|mut f| f.read_exact(&mut process));
        random.map_err(|e| Failure::own(format!("/dev/urandom: {e}")))?;
        Ok(Bus {
            session,
            start,
            endpoint: endpoint.into(),
            process,
            asked: 0,
            pending: None,
            arrivals,
            requests,
            payloads,
            kept,
            wanted,
            repeater,
            subscribers,
            token,
            lost_at: None,
        })
    }

    /// Withdraw the token, then close the session.
    pub fn close(self) -> Result<()> {
        self.token.undeclare().wait().map_err(trouble)?;
        let _ = self.wanted.send(None);
        let _ = self.repeater.join();
        drop(self.subscribers);
        self.session.close().wait().map_err(trouble)
    }

    /// Whether a request has not been answered yet.
    pub fn pending(&self) -> bool {
        self.pending.is_some()
    }

    /// Send a request; it is sent again until it is answered. There is one at a time.
    pub fn request(&mut self, kind: &'static str, frame: Vec<u8>) -> Result<()> {
        check_size(&frame)?;
        self.asked += 1;
        let mut number = UNASKED;
        number[..8].copy_from_slice(&self.process);
        number[8..].copy_from_slice(&self.asked.to_le_bytes());
        self.pending = Some(Pending { kind, frame, number, sent: Instant::now() });
        self.send_request()
    }

    /// Send the pending request once the coupler can take it.
    fn send_request(&mut self) -> Result<()> {
        let Some(pending) = &mut self.pending else { return Ok(()) };
        let publisher = &self.requests[pending.kind];
        let deadline = Instant::now() + RECONNECT;
        while !publisher.matching_status().wait().map_err(trouble)?.matching() {
            if Instant::now() > deadline {
                return Err(gone(&self.endpoint));
            }
            sleep(Duration::from_millis(2));
        }
        let put = publisher.put(pending.frame.clone()).attachment(pending.number);
        put.wait().map_err(trouble)?;
        pending.sent = Instant::now();
        Ok(())
    }

    /// The next event; None if none comes within the time.
    pub fn receive(&mut self, timeout: Duration) -> Result<Option<Event>> {
        let until = Instant::now() + timeout;
        loop {
            if self.lost_at.is_some_and(|at| at.elapsed() > RECONNECT) {
                return Err(gone(&self.endpoint));
            }
            if self.pending.as_ref().is_some_and(|p| p.sent.elapsed() > REPEAT) {
                self.send_request()?;
            }
            let left = until.saturating_duration_since(Instant::now());
            match self.arrivals.1.recv_timeout(left.min(Duration::from_millis(500))) {
                Ok(Arrival::Payload(peer, frame)) => return Ok(Some(Event::Payload(peer, frame))),
                Ok(Arrival::Answer(number, frame)) => {
                    let answers = self.pending.as_ref().is_some_and(|p| p.number == number);
                    if answers {
                        self.pending = None;
                    }
                    if answers || number == UNASKED {
                        return Ok(Some(Event::Answer(frame)));
                    }
                }
                Ok(Arrival::Coupler(false)) => self.lost_at = Some(Instant::now()),
                Ok(Arrival::Coupler(true)) => {
                    if self.lost_at.take().is_some() {
                        self.send_request()?; // it may have been lost
                        return Ok(Some(Event::Reconnected));
                    }
                }
                Err(RecvTimeoutError::Timeout) if left > Duration::from_millis(500) => {}
                Err(_) => return Ok(None),
            }
        }
    }

    /// Send the payload of a step to all ranks that subscribe to it, and keep it.
    pub fn publish(&self, step: i64, frame: Vec<u8>) -> Result<()> {
        check_size(&frame)?;
        self.kept.lock().unwrap().insert(step, frame.clone());
        self.payloads.put(frame).wait().map_err(trouble)
    }

    /// Drop the payloads of the steps before one: nobody can ask for them.
    pub fn forget(&self, before: i64) {
        self.kept.lock().unwrap().retain(|step, _| *step >= before);
    }

    /// Receive the payloads of another rank.
    pub fn subscribe(&mut self, peer: &str) -> Result<()> {
        let (queue, name) = (self.arrivals.0.clone(), peer.to_string());
        let subscriber = self.session.declare_subscriber(format!("{}/data/{peer}", self.start));
        let subscriber = subscriber.callback(move |sample| {
            let frame = sample.payload().to_bytes().into();
            let _ = queue.send(Arrival::Payload(name.clone(), frame));
        });
        self.subscribers.push(subscriber.wait().map_err(trouble)?);
        Ok(())
    }

    /// Ask another rank to send the payload of a step once more.
    pub fn ask_again(&self, peer: &str, step: i64) -> Result<()> {
        self.session
            .put(format!("{}/again/{peer}", self.start), step.to_le_bytes())
            .congestion_control(CongestionControl::Drop)
            .express(true)
            .wait()
            .map_err(trouble)
    }
}

fn on_matching(publisher: &Publisher, take: impl Fn(bool) + Send + Sync + 'static) -> Result<()> {
    let listener = publisher.matching_listener().callback(move |status| take(status.matching()));
    listener.background().wait().map_err(trouble)
}

fn check_size(frame: &[u8]) -> Result<()> {
    if frame.len() <= LARGEST {
        return Ok(());
    }
    Err(Failure::own(format!("a frame of {} bytes is too large for the bus", frame.len())))
}

fn trouble(error: zenoh::Error) -> Failure {
    Failure::own(format!("Zenoh: {error}"))
}

fn gone(endpoint: &str) -> Failure {
    Failure::Lost(format!("the coupler at {endpoint} is gone: no connection for 2 s"))
}

/// The settings of the section "Transport" of the protocol.
fn settings(endpoint: &str, keys: &Path, patience: f64) -> Result<Config> {
    let link = endpoint.split('/').next().unwrap_or_default();
    let mut settings = vec![
        ("mode", json!("client")),
        ("connect/endpoints", json!([endpoint])),
        ("connect/timeout_ms", json!((1000.0 * patience) as u64)),
        ("connect/exit_on_failure", json!(true)),
        (
            "connect/retry",
            json!({"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 2}),
        ),
        ("scouting/multicast/enabled", json!(false)),
        ("scouting/gossip/enabled", json!(false)),
        ("transport/link/protocols", json!([link])),
        ("transport/link/tx/lease", json!(2000)),
        ("transport/link/tx/keep_alive", json!(4)),
        (
            "transport/link/tx/queue/congestion_control/drop",
            json!({"wait_before_drop": 30_000_000, "max_wait_before_drop_fragments": 600_000_000}),
        ),
        ("transport/link/rx/max_message_size", json!(LARGEST)),
    ];
    if link == "tls" {
        let word = fs::read_to_string(key(keys, &format!("{ROLE}.password"), true)?);
        let word = word.map_err(|e| Failure::Input(format!("{}: {e}", keys.display())))?;
        settings.push(("transport/auth/usrpwd/user", json!(ROLE)));
        settings.push(("transport/auth/usrpwd/password", json!(word.trim())));
        settings.push(("transport/link/tls", tls(keys)?));
    }
    let mut config = Config::default();
    for (key, value) in settings {
        config.insert_json5(key, &value.to_string()).map_err(trouble)?;
    }
    Ok(config)
}

fn tls(keys: &Path) -> Result<Value> {
    let name = ME.replace('/', "-");
    Ok(json!({
        "root_ca_certificate": key(keys, "authority.pem", false)?,
        "connect_certificate": key(keys, &format!("{name}.pem"), false)?,
        "connect_private_key": key(keys, &format!("{name}.key"), true)?,
        "enable_mtls": true,
        "verify_name_on_connect": true,
    }))
}

/// The path of a file of the keys; a secret must be readable for its owner only.
fn key(folder: &Path, name: &str, secret: bool) -> Result<String> {
    let path = folder.join(name);
    let mode = fs::metadata(&path).map(|found| found.permissions().mode());
    match mode {
        Err(error) => Err(Failure::Input(format!("{}: {error}", path.display()))),
        Ok(mode) if secret && mode & 0o077 != 0 => Err(Failure::Input(format!(
            "{}: other users can read this secret; chmod 600 it",
            path.display()
        ))),
        Ok(_) => Ok(path.display().to_string()),
    }
}
