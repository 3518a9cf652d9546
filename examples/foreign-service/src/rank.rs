//! This rank in the run: registration, payloads, grants, reports, and the end.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{json, Value};
use signal_hook::{consts::SIGTERM, flag};

use crate::bus::{Bus, Event, ROLE};
use crate::failure::Failure;
use crate::frame::{decode, encode, Array, Arrays, Elements};
use crate::plan::Plan;

const PROTOCOL: i64 = 4;
/// Time after which a rank tells the coupler whom it waits for.
const NOTICE: Duration = Duration::from_millis(100);
/// Longest time between two reports.
const REPORT: Duration = Duration::from_millis(500);
/// Times after which a payload that has not come is asked for: the first, and the longest.
const AGAIN: (Duration, Duration) = (Duration::from_millis(200), Duration::from_secs(5));
/// The coupler watches all ranks, so this finds only a coupler that hangs.
const PATIENCE: Duration = Duration::from_secs(1800);

type Result<T> = std::result::Result<T, Failure>;

/// How the service was started.
pub struct Options {
    pub run_dir: PathBuf,
    pub run: String,
    pub endpoint: String,
    pub keys: PathBuf,
    pub patience: f64,
}

/// Where the fields of a rank of the other side go.
struct Source {
    name: String,
    rows: Vec<usize>,
    places: Vec<usize>,
}

pub struct Rank {
    bus: Bus,
    sources: Vec<Source>,
    needed: usize,
    payloads: HashMap<(String, i64), Arrays>,
    step: i64,
    granted: i64,
    last: i64,
    done: i64,
    /// Step at which half of the grant is used up.
    report_at: i64,
    reported: Instant,
    waited: f64,
    steps: Vec<Value>,
    saved: Vec<Value>,
    checkpoints: Vec<i64>,
    holds: Option<i64>,
    /// Somebody has asked this process to end; see `end_at_sigterm`.
    stop: Arc<AtomicBool>,
    stop_sent: bool,
    /// The user has been told of frames that are no payloads.
    warned: bool,
}

/// Let SIGTERM end the process with code 3 as long as the flag is set, as it is now.
///
/// From the registration on, the first SIGTERM sets it, and the second one ends the process.
pub fn end_at_sigterm() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(true));
    flag::register_conditional_shutdown(SIGTERM, 3, stop.clone()).map_err(Failure::own)?;
    Ok(stop)
}

impl Rank {
    pub fn new(bus: Bus, stop: Arc<AtomicBool>) -> Rank {
        Rank {
            bus,
            sources: Vec::new(),
            needed: 0,
            payloads: HashMap::new(),
            step: -1,
            granted: -1,
            last: -1,
            done: -1,
            report_at: -1,
            reported: Instant::now(),
            waited: 0.0,
            steps: Vec::new(),
            saved: Vec::new(),
            checkpoints: Vec::new(),
            holds: None,
            stop,
            stop_sent: false,
            warned: false,
        }
    }

    /// Take part in the run: returns when all ranks of both sides have been accepted.
    ///
    /// The rank offers and needs the same nodes, as in the force scheme. `step` is that of the
    /// checkpoint from which it goes on, or 0.
    pub fn register(
        &mut self,
        options: &Options,
        plan: &Plan,
        nodes: &[i64],
        step: i64,
    ) -> Result<()> {
        let message = json!({
            "type": "Register",
            "protocol": PROTOCOL,
            "run": options.run,
            "plan": plan.digest,
            "role": ROLE,
            "rank": 0,
            "ranks": 1,
            "backend": concat!("foreign-service ", env!("CARGO_PKG_VERSION"), " (Rust)"),
            "units": plan.units,
            "dt": plan.step,
            "patch": plan.domain.r#box,
            "first_step": step,
            "host": fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default().trim(),
            "pid": std::process::id(),
        });
        let arrays = [("offers", Array::integers(nodes)), ("needs", Array::integers(nodes))];
        self.bus.request("register", encode(&message, &arrays))?;
        let (answer, arrays) = self.answer(PATIENCE)?;
        if answer["type"] != "Accepted" {
            return Err(refusal(&answer));
        }
        for rank in answer["sources"].as_array().into_iter().flatten() {
            let indices = |name: &str| -> Result<Vec<usize>> {
                match arrays.get(&format!("{name}_{rank}")).map(|array| &array.elements) {
                    Some(Elements::Integers(list)) => {
                        Ok(list.iter().map(|i| *i as usize).collect())
                    }
                    _ => Err(Failure::own(format!("Accepted has no array {name}_{rank}"))),
                }
            };
            let (rows, places) = (indices("rows")?, indices("places")?);
            let name = format!("md/{rank}");
            self.bus.subscribe(&name)?;
            self.sources.push(Source { name, rows, places });
        }
        self.needed = nodes.len();
        self.step = number(&answer, "first_step")? - 1;
        self.done = self.step;
        self.last = number(&answer, "last_step")?;
        self.granted = number(&answer, "granted")?;
        self.stop.store(false, Ordering::Relaxed);
        flag::register(SIGTERM, self.stop.clone()).map_err(Failure::own)?;
        Ok(())
    }

    /// Send the velocities of the offered nodes at the next step.
    pub fn send(&mut self, velocity: &[[f64; 2]]) -> Result<()> {
        self.step += 1;
        if velocity.is_empty() {
            return Ok(());
        }
        if !velocity.iter().flatten().all(|v| v.is_finite()) {
            let reason = "its velocities are not finite: take a shorter time step";
            return Err(Failure::own(format!("step {}: {reason}", self.step)));
        }
        let message = json!({"type": "Payload", "role": ROLE, "rank": 0, "step": self.step});
        let fields = [("velocity", Array::vectors(velocity))];
        self.bus.publish(self.step, encode(&message, &fields))
    }

    /// Wait until this rank may leave the step, and the payloads of the step have come.
    ///
    /// Returns the forces of the atoms on the needed nodes; None in a run of the continuum only.
    pub fn wait(&mut self) -> Result<Option<Vec<[f64; 2]>>> {
        let start = Instant::now();
        let (mut pause, mut noticed) = (AGAIN.0, false);
        let mut ask_at = start + pause;
        while !self.ready() {
            let event = self.take_next(NOTICE)?;
            match event {
                Some(Event::Reconnected) => ask_at = Instant::now(),
                Some(_) => continue,
                None => {}
            }
            if (!noticed || self.must_say_stop()) && !self.bus.pending() {
                self.send_report(self.missing())?;
                noticed = true;
            }
            if Instant::now() >= ask_at {
                pause = (2 * pause).min(AGAIN.1);
                ask_at = Instant::now() + pause;
                for peer in self.missing() {
                    self.bus.ask_again(&peer, self.step)?;
                }
            }
            if start.elapsed() > PATIENCE {
                let whom = if self.missing().is_empty() {
                    "the coupler".into()
                } else {
                    self.missing().join(", ")
                };
                return Err(Failure::Lost(format!(
                    "waited {PATIENCE:?} at step {} for {whom}",
                    self.step
                )));
            }
        }
        self.waited = start.elapsed().as_secs_f64();
        self.gather()
    }

    /// Whether this is the last step.
    pub fn at_last(&self) -> bool {
        self.step == self.last
    }

    pub fn step(&self) -> i64 {
        self.step
    }

    /// Whether the coupler wants a checkpoint of this step.
    pub fn must_save(&self) -> bool {
        self.checkpoints.contains(&self.step)
    }

    /// Tell the coupler, with the next report, that the state of this step is on disk.
    pub fn note_saved(&mut self, digest: String) {
        self.saved.push(json!({"step": self.step, "digest": digest}));
    }

    /// Report this step; at the last one, wait until all ranks have completed it.
    pub fn report(
        &mut self,
        energies: Option<Value>,
        mut timings: BTreeMap<&str, f64>,
        findings: Vec<Value>,
    ) -> Result<()> {
        timings.insert("wait", self.waited);
        self.steps.push(json!({
            "step": self.step, "energies": energies, "timings": timings, "findings": findings,
        }));
        if self.at_last() {
            self.settle()?;
            while !self.steps.is_empty() || self.done < self.last {
                self.send_report(Vec::new())?;
                self.settle()?;
            }
        } else if !self.bus.pending()
            && (self.step >= self.report_at
                || self.reported.elapsed() > REPORT
                || self.must_say_stop())
        {
            self.send_report(Vec::new())?;
        }
        Ok(())
    }

    /// Tell the coupler why this rank ends, unless the coupler knows.
    pub fn fail(&mut self, failure: &Failure) -> Result<()> {
        let (message, culprit) = match failure {
            Failure::Lost(_) => return Ok(()),
            Failure::Input(reason) => (reason, ""),
            Failure::Failed { reason, culprit } => (reason, culprit.as_str()),
        };
        let message = json!({
            "type": "Failed", "role": ROLE, "rank": 0, "message": message,
            "exit_code": failure.exit_code(), "culprit": culprit,
        });
        self.bus.request("failed", encode(&message, &[]))?;
        self.answer(Duration::from_secs(2)).map(|_| ())
    }

    pub fn close(self) -> Result<()> {
        self.bus.close()
    }

    fn missing(&self) -> Vec<String> {
        let here =
            |source: &&Source| !self.payloads.contains_key(&(source.name.clone(), self.step));
        self.sources.iter().filter(here).map(|source| source.name.clone()).collect()
    }

    fn ready(&self) -> bool {
        (self.step < self.granted || self.at_last()) && self.missing().is_empty()
    }

    fn must_say_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed) && !self.stop_sent
    }

    /// Take what arrives until the pending request is answered.
    fn settle(&mut self) -> Result<()> {
        let start = Instant::now();
        while self.bus.pending() {
            self.take_next(NOTICE)?;
            if start.elapsed() > PATIENCE {
                return Err(silent(PATIENCE));
            }
        }
        Ok(())
    }

    /// The answer to the pending request.
    fn answer(&mut self, patience: Duration) -> Result<(Value, Arrays)> {
        let start = Instant::now();
        while start.elapsed() < patience {
            if let Some(Event::Answer(frame)) = self.bus.receive(NOTICE)? {
                if !self.bus.pending() {
                    return decode(&frame).map_err(Failure::own);
                }
            }
        }
        Err(silent(patience))
    }

    fn take_next(&mut self, timeout: Duration) -> Result<Option<Event>> {
        let event = self.bus.receive(timeout)?;
        match &event {
            Some(Event::Answer(frame)) => self.take_answer(frame)?,
            Some(Event::Payload(peer, frame)) => self.take_payload(peer, frame),
            Some(Event::Reconnected) | None => {}
        }
        Ok(event)
    }

    fn take_answer(&mut self, frame: &[u8]) -> Result<()> {
        let (grant, _) = decode(frame).map_err(Failure::own)?;
        if grant["type"] != "Grant" {
            return Err(refusal(&grant));
        }
        self.granted = number(&grant, "granted")?;
        self.last = number(&grant, "last")?;
        self.done = number(&grant, "done")?;
        let steps = grant["checkpoints"].as_array();
        self.checkpoints = steps.into_iter().flatten().filter_map(Value::as_i64).collect();
        self.report_at = (self.step + self.granted).div_euclid(2);
        self.holds = None;
        self.bus.forget(self.done);
        if grant["recall"] == true {
            self.granted = self.step;
            self.holds = Some(self.step);
            if !self.bus.pending() {
                self.send_report(Vec::new())?;
            }
        }
        Ok(())
    }

    /// Keep a payload; one that came before changes nothing. What is no payload of this rank does
    /// not come from it, and its own payload is still on its way.
    fn take_payload(&mut self, peer: &str, frame: &[u8]) {
        match decode(frame) {
            Ok((message, arrays)) => {
                let sender =
                    format!("{}/{}", message["role"].as_str().unwrap_or(""), message["rank"]);
                let step = message["step"].as_i64().unwrap_or(-1);
                if message["type"] == "Payload" && sender == peer && step >= self.step {
                    self.payloads.entry((peer.into(), step)).or_insert(arrays);
                }
            }
            Err(reason) if !self.warned => {
                eprintln!("ignored frames in the name of {peer}, the first because {reason}");
                self.warned = true; // there may be many
            }
            Err(_) => {}
        }
    }

    fn gather(&mut self) -> Result<Option<Vec<[f64; 2]>>> {
        let mut force = vec![[0.0; 2]; self.needed];
        for source in &self.sources {
            let key = (source.name.clone(), self.step);
            let values =
                forces(&self.payloads[&key], &source.rows).map_err(|reason| Failure::Failed {
                    reason: format!("{} sends at step {} {reason}", source.name, self.step),
                    culprit: source.name.clone(),
                })?;
            for (place, value) in source.places.iter().zip(values) {
                force[*place] = value;
            }
        }
        let step = self.step;
        self.payloads.retain(|(_, of), _| *of > step);
        Ok((!self.sources.is_empty()).then_some(force))
    }

    fn send_report(&mut self, waits_for: Vec<String>) -> Result<()> {
        let stop = self.stop.load(Ordering::Relaxed);
        self.stop_sent |= stop;
        let message = json!({
            "type": "Report", "role": ROLE, "rank": 0, "steps": self.steps,
            "peak_memory": peak_memory(), "waits_for": waits_for, "holds": self.holds,
            "saved": self.saved, "stop": stop,
        });
        self.bus.request("report", encode(&message, &[]))?;
        (self.steps, self.saved, self.reported) = (Vec::new(), Vec::new(), Instant::now());
        Ok(())
    }
}

/// The chosen rows of the field `force`, or what is wrong with it.
fn forces(arrays: &Arrays, rows: &[usize]) -> std::result::Result<Vec<[f64; 2]>, String> {
    let array = arrays.get("force").ok_or("no field 'force'")?;
    let least = rows.iter().max().map_or(0, |row| row + 1);
    let (Elements::Floats(values), [n, 2]) = (&array.elements, &array.shape[..]) else {
        return Err(format!("'force' of another type, or of shape {:?}", array.shape));
    };
    if *n < least {
        return Err(format!("'force' on {n} nodes, but at least {least} are needed"));
    }
    if !values.iter().all(|value| value.is_finite()) {
        return Err("'force' that is not finite".into());
    }
    Ok(rows.iter().map(|row| [values[2 * row], values[2 * row + 1]]).collect())
}

fn number(message: &Value, key: &str) -> Result<i64> {
    let found = message[key].as_i64();
    found.ok_or_else(|| Failure::own(format!("{} has no number {key}", message["type"])))
}

fn refusal(answer: &Value) -> Failure {
    let reason = answer["reason"].as_str().unwrap_or("the coupler refused without a reason");
    Failure::Lost(reason.into())
}

fn silent(patience: Duration) -> Failure {
    Failure::Lost(format!("the coupler has not answered for {patience:?}"))
}

/// Largest resident memory of this process so far, bytes.
fn peak_memory() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    1024 * kilobytes.unwrap_or(0)
}
