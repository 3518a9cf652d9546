//! Checkpoints: the state of this rank in a file, and the latest one that counts.
//!
//! The file holds little-endian numbers: the number of nodes and of shared nodes, displacements,
//! velocities, forces of the atoms, and the works. All else follows from these and from the plan.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::failure::Failure;
use crate::plan::hex;
use crate::solid::Solid;

/// The protocol names the file, whatever its format.
const FILE: &str = "continuum.0.h5";

/// Save the state at a step; returns the digest of the file, which is on disk then.
pub fn save(run_dir: &Path, step: i64, solid: &Solid) -> Result<String, Failure> {
    let (mut bytes, numbers) = (Vec::new(), numbers(solid));
    for size in [solid.u.len(), solid.force.len()] {
        bytes.extend((size as u64).to_le_bytes());
    }
    bytes.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
    let folder = folder(run_dir, step);
    write(&folder, &bytes).map_err(|error| {
        Failure::own(format!("cannot save the checkpoint in {}: {error}", folder.display()))
    })?;
    Ok(hex(&Sha256::digest(&bytes)))
}

/// Go on from the latest checkpoint; returns its step, or None if there is none.
pub fn restore(run_dir: &Path, solid: &mut Solid) -> Result<Option<i64>, Failure> {
    let Some((step, manifest)) = latest(run_dir)? else { return Ok(None) };
    let path = folder(run_dir, step).join(FILE);
    let trouble = |what: &str| Failure::own(format!("{}: {what}", path.display()));
    let bytes = fs::read(&path).map_err(|error| trouble(&error.to_string()))?;
    if manifest["files"][FILE] != hex(&Sha256::digest(&bytes)) {
        return Err(trouble("is damaged: its digest is not that of the manifest"));
    }
    let words: Vec<[u8; 8]> = bytes.chunks_exact(8).map(|word| word.try_into().unwrap()).collect();
    let (u, shared) = (solid.u.len(), solid.force.len());
    let sizes = [u as u64, shared as u64].map(u64::to_le_bytes);
    if words.len() != 2 + 4 * u + 2 * shared + 2 || words[..2] != sizes {
        return Err(trouble("belongs to another case, or to another code"));
    }
    let mut rest = words[2..].iter().map(|word| f64::from_le_bytes(*word));
    let vectors = solid.u.iter_mut().chain(&mut solid.v).chain(&mut solid.force).flatten();
    for number in vectors.chain([&mut solid.interface_work, &mut solid.external_work]) {
        *number = rest.next().expect("the number of words has been checked");
    }
    Ok(Some(step))
}

fn numbers(solid: &Solid) -> Vec<f64> {
    let vectors = solid.u.iter().chain(&solid.v).chain(&solid.force).flatten();
    vectors.chain([&solid.interface_work, &solid.external_work]).copied().collect()
}

fn folder(run_dir: &Path, step: i64) -> PathBuf {
    run_dir.join("checkpoints").join(step.to_string())
}

fn write(folder: &Path, bytes: &[u8]) -> std::io::Result<()> {
    fs::create_dir_all(folder)?;
    let mut file = File::create(folder.join(FILE))?;
    file.write_all(bytes)?;
    file.sync_all()?;
    File::open(folder)?.sync_all()
}

/// The checkpoint with the largest step that has a manifest.
fn latest(run_dir: &Path) -> Result<Option<(i64, Value)>, Failure> {
    let Ok(entries) = fs::read_dir(run_dir.join("checkpoints")) else { return Ok(None) };
    let steps = entries.flatten().filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    let with_manifest = |step: &i64| folder(run_dir, *step).join("manifest.json").exists();
    let Some(step) = steps.filter(with_manifest).max() else { return Ok(None) };
    let path = folder(run_dir, step).join("manifest.json");
    let text = fs::read(&path).map_err(|error| error.to_string());
    let manifest = text.and_then(|text| serde_json::from_slice(&text).map_err(|e| e.to_string()));
    manifest
        .map(|found| Some((step, found)))
        .map_err(|error| Failure::own(format!("{}: {error}", path.display())))
}
