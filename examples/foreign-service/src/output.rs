//! Output: one file of nodes for each output step, for ParaView (legacy VTK).

use std::fmt::Write;
use std::fs;
use std::path::Path;

use crate::failure::Failure;
use crate::plan::Pair;
use crate::solid::Solid;

const START: &str = "nodes.";

/// Write displacements and velocities of the nodes of the domain.
pub fn write(run_dir: &Path, step: i64, solid: &Solid) -> Result<(), Failure> {
    let (grid, folder) = (&solid.grid, run_dir.join("fields"));
    let [nx, ny] = grid.cells.map(|n| n + 1);
    let mut text = format!(
        "# vtk DataFile Version 3.0\nstep {step}\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS {nx} \
         {ny} 1\nORIGIN {} {} 0\nSPACING {h} {h} {h}\nPOINT_DATA {}\n",
        grid.low[0],
        grid.low[1],
        nx * ny,
        h = grid.h,
    );
    for (name, values) in [("displacement", &solid.u), ("velocity", &solid.v)] {
        let _ = writeln!(text, "VECTORS {name} double");
        for node in (0..ny).flat_map(|j| (0..nx).map(move |i| [i, j])) {
            let [x, y]: Pair = values[grid.id(node)];
            let _ = writeln!(text, "{x:e} {y:e} 0");
        }
    }
    let path = folder.join(format!("{START}{step:010}.vtk"));
    fs::create_dir_all(&folder)
        .and_then(|()| fs::write(&path, text))
        .map_err(|error| Failure::own(format!("cannot write {}: {error}", path.display())))
}

/// Remove what was written after a checkpoint.
pub fn cut(run_dir: &Path, step: i64) -> Result<(), Failure> {
    let Ok(entries) = fs::read_dir(run_dir.join("fields")) else { return Ok(()) };
    for path in entries.flatten().map(|entry| entry.path()) {
        let name = path.file_stem().and_then(|name| name.to_str()).unwrap_or_default();
        let of = name.strip_prefix(START).and_then(|number| number.parse::<i64>().ok());
        if of.is_some_and(|of| of > step) {
            fs::remove_file(&path).map_err(|e| Failure::own(format!("{}: {e}", path.display())))?;
        }
    }
    Ok(())
}
