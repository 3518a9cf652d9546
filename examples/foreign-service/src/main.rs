//! A continuum service for gimpmd, which relies on `schemas/protocol.md` only.

#![allow(non_snake_case)] // F, H, P, R and C are the names of the literature

mod bonds;
mod bus;
mod checkpoint;
mod failure;
mod frame;
mod grid;
mod initial;
mod interface;
mod output;
mod plan;
mod rank;
mod solid;
mod units;

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use bus::Bus;
use failure::Failure;
use plan::Plan;
use rank::{end_at_sigterm, Options, Rank};
use solid::Solid;

const USAGE: &str = "usage: foreign-service --run-dir DIR --run ID --connect ENDPOINT \
                     [--keys DIR] [--patience SECONDS]";

fn main() -> ExitCode {
    match options().and_then(|options| serve(&options)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("foreign-service: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

fn options() -> Result<Options, Failure> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let mut given: HashMap<&str, &str> = HashMap::new();
    for pair in words.chunks(2) {
        let known = ["--run-dir", "--run", "--connect", "--keys", "--patience"];
        match pair {
            [name, value] if known.contains(&name.as_str()) => given.insert(name, value),
            _ => return Err(Failure::Input(USAGE.into())),
        };
    }
    let needed = |name| given.get(name).copied().ok_or(Failure::Input(USAGE.into()));
    let run_dir = PathBuf::from(needed("--run-dir")?);
    let patience = given.get("--patience").map_or(Ok(5.0), |text| text.parse());
    Ok(Options {
        run: needed("--run")?.into(),
        endpoint: needed("--connect")?.into(),
        keys: given.get("--keys").map_or(run_dir.join("keys"), PathBuf::from),
        patience: patience.map_err(|_| Failure::Input("--patience: is no number".into()))?,
        run_dir,
    })
}

/// Take part in the run until the coupler tells this rank to stop.
fn serve(options: &Options) -> Result<(), Failure> {
    let stop = end_at_sigterm()?;
    let plan = Plan::load(&options.run_dir); // the coupler is told of a plan that cannot be used
    let bus = Bus::open(&options.endpoint, &options.run, &options.keys, options.patience)?;
    let mut rank = Rank::new(bus, stop);
    let ended = plan.and_then(|plan| run(&mut rank, options, &plan));
    if let Err(failure) = &ended {
        if let Err(silence) = rank.fail(failure) {
            eprintln!("foreign-service: could not report the failure: {silence}");
        }
    }
    let closed = rank.close();
    ended.and(closed)
}

fn run(rank: &mut Rank, options: &Options, plan: &Plan) -> Result<(), Failure> {
    plan.check()?;
    let mut solid = Solid::new(plan)?;
    let saved = checkpoint::restore(&options.run_dir, &mut solid)?;
    rank.register(options, plan, &solid.shared, saved.unwrap_or(0))?;
    eprintln!("foreign-service: {}; accepted from step {}", solid.summary(), saved.unwrap_or(0));
    if let Some(step) = saved {
        output::cut(&options.run_dir, step)?;
    }
    let mut restored = saved.is_some(); // the step of a checkpoint has been finished and saved
    loop {
        let mut timings = BTreeMap::new();
        rank.send(&solid.velocities())?;
        let step = rank.step();
        // the atoms move meanwhile
        timed(&mut timings, "finish", || solid.finish());
        if !restored && (step % plan.output_every == 0 || step == plan.steps) {
            timed(&mut timings, "output", || output::write(&options.run_dir, step, &solid))?;
        }
        let force = rank.wait()?;
        let last = rank.at_last();
        if !restored && (rank.must_save() || plan.saves(step)) {
            let digest = timed(&mut timings, "checkpoint", || {
                checkpoint::save(&options.run_dir, step, &solid)
            })?;
            rank.note_saved(digest);
        }
        restored = false;
        let due = step % plan.energies_every == 0;
        let findings = if due { solid.findings() } else { Vec::new() };
        if let Some(force) = force {
            solid.receive(force, step == 0);
        }
        let energies = if last {
            solid.energies_at_end(step)
        } else {
            timed(&mut timings, "step", || solid.advance(step))
        };
        rank.report(due.then_some(energies), timings, findings)?;
        if last {
            return Ok(());
        }
    }
}

/// Do a piece of work, and add its wall time to a phase.
fn timed<T>(timings: &mut BTreeMap<&str, f64>, phase: &'static str, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let done = work();
    timings.insert(phase, start.elapsed().as_secs_f64());
    done
}
