"""Blind cases on disk: experiment folders like those of a user, and sealed labels with the hidden causes.

A case is a folder of experiments. `fit` and `heldout` are what the diagnosis may see. `twin_fit` and `twin` are the
same releases without the hidden causes: same incident states, soil draws and noise, recorded by the correct camera; a
case from a real record has none. Twins are sealed like the labels, because a comparison with the films would reveal the
causes. Only the measurement of the true floor may read them; a diagnosis does not see it."""

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.blind.cases import Case, assign_causes, draw_case
from rock2d.blind.record_cases import Record, records_of_cases, write_record_case
from rock2d.blind.signal_to_noise import signals_to_noise
from rock2d.errors import InputError
from rock2d.files.folders import atomic_folder
from rock2d.files.text_files import read_json, read_text
from rock2d.processes import as_finished

KIND = "blind trial"  # of a folder of results
CASES, LABELS, INDEX_FILE = "cases", "labels.json", "cases.json"
FIT, HELDOUT, TWIN_FIT, TWIN = "fit", "heldout", "twin_fit", "twin"  # experiments of a case


def make_trial(
    count: int, seed: int, out: Path, *, causes: list[tuple[str, ...]] | None = None,
    records: Sequence[Record] = (), workers: int = 1, on_case: Callable[[], Any] = lambda: None,
) -> str:  # fmt: skip
    """Write `count` sealed cases into the new folder `out`; returns the SHA-256 of the labels.

    `out` gets cases/NNN/{fit,heldout,twin_fit,twin}, cases.json (seed, count, SHA-256 of the labels) and
    labels.json, which only `rock2d blind score` opens. `causes`: hidden causes of the cases; default: assigned by the
    seed; `records`: real records, which are the base of a share of the cases."""
    root = np.random.SeedSequence(seed)
    assigning, *children = root.spawn(count + 1)
    causes = assign_causes(count, assigning) if causes is None else causes
    bases = records_of_cases(causes, len(records), assigning.spawn(1)[0])
    labels = {}
    with atomic_folder(out, KIND) as folder:
        jobs = [
            (case_causes, child, folder / CASES / f"{i:03d}", None if base is None else records[base])
            for i, (case_causes, child, base) in enumerate(zip(causes, children, bases, strict=True))
        ]
        with closing(as_finished(_make, jobs, workers)) as made:
            for _, (name, label) in made:
                labels[name] = label
                on_case()
        labels = dict(sorted(labels.items()))
        text = json.dumps(labels, indent=1) + "\n"
        digest = hashlib.sha256(text.encode()).hexdigest()
        (folder / LABELS).write_text(text, encoding="utf-8")
        index = {"count": count, "seed": seed, "labels_sha256": digest}
        (folder / INDEX_FILE).write_text(json.dumps(index, indent=1) + "\n", encoding="utf-8")
    return digest


def _make(
    causes: tuple[str, ...], seed: np.random.SeedSequence, folder: Path, record: Record | None
) -> tuple[str, dict[str, Any]]:
    if record is not None:
        return folder.name, write_record_case(record, causes, seed, folder / FIT, folder / HELDOUT)
    return folder.name, write_case(draw_case(causes, seed), folder)


def write_case(case: Case, folder: Path) -> dict[str, Any]:
    """Film a case into folder/fit and folder/heldout, and its twins without causes; returns its label."""
    times = case.times_s
    film = case.filmed(times, case.hidden, noisy=True)
    twin = case.filmed(times, [], noisy=True) if case.hidden else film
    law = case.world.law
    together, each = signals_to_noise(case)
    for recorded, (fit, heldout) in ((film, (FIT, HELDOUT)), (twin, (TWIN_FIT, TWIN))):
        for name, mask in ((fit, ~case.heldout), (heldout, case.heldout)):
            _write(case, folder / name, folder.name, recorded[mask], times, np.flatnonzero(mask))
    return {
        "label": case.label,
        "hidden": [
            {"name": h.name, "form": h.form, "values": h.values, "signal_to_noise": z}
            for h, z in zip(case.hidden, each, strict=True)
        ],
        "signal_to_noise": together,
        "kind": case.kind,
        "blocks": [b.name for b in case.world.blocks],
        "releases": int((~case.heldout).sum()),
        "fps": case.fps,
        "block_size_m": 2.0 * float(np.mean([b.radius_m for b in case.world.blocks])),
        "position_noise_m": case.camera.position_noise_m,
        "angle_noise_rad": case.camera.angle_noise_rad,
        "soil_sd": case.soil_sd.tolist(),
        "law": {name: float(getattr(law, name)) for name in ("k_l", "k_ul", "k_t", "mu", "k_r", "indentation")},
    }


def _write(case: Case, folder: Path, name: str, recorded: Array, times: Array, releases: Array) -> None:
    folder.mkdir(parents=True, exist_ok=True)  # a worker that died may have made it
    rows = ["release,block,t_s,x_m,y_m,theta_rad"]
    for number, (i, film) in enumerate(zip(releases, recorded, strict=True)):
        block = case.world.blocks[case.releases.block_ids[i]].name
        theta = (film[:, 2] + np.pi) % (2 * np.pi) - np.pi
        for t, (x, y, _), angle in zip(times, film, theta, strict=True):
            if np.isfinite(x):
                rows.append(f"{number},{block},{t:.6f},{x:.6g},{y:.6g},{angle:.5f}")
    (folder / "trajectories.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    points = ", ".join(f"[{x:.6g}, {y:.6g}]" for x, y in case.world.setup.points_m)
    lines = [
        f"name: case_{name}",
        f"gravity_m_s2: {case.world.gravity_m_s2}",
        "camera:",
        f"  fps: {case.fps}",
        f"  position_noise_m: {case.camera.position_noise_m:.6g}",
        f"  angle_noise_rad: {case.camera.angle_noise_rad:.6g}",
        "cross_section:",
        f"  points_m: [{points}]",
        f"  zones: [{', '.join(case.world.setup.zones)}]",
        "blocks:",
    ]
    for block, shape in zip(case.world.blocks, case.shapes, strict=True):
        sizes = ", ".join(f"{k}: {v if isinstance(v, str) else format(v, '.6g')}" for k, v in shape.items())
        lines.append(f"  {block.name}: {{{sizes}, mass_kg: {block.mass_kg:.6g}, inertia: {block.inertia_kg_m2:.6g}}}")
    lines.append("trajectories: trajectories.csv")
    (folder / "experiment.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_index(folder: Path) -> dict[str, Any]:
    """Content of cases.json of a trial; raises `InputError` if there is none."""
    path = folder / INDEX_FILE
    if not path.exists():
        raise InputError("found no trial; `rock2d blind make` writes one", folder, code="missing_file")
    index = read_json(path)
    kinds = {"count": int, "seed": int, "labels_sha256": str}
    if not isinstance(index, dict) or any(not isinstance(index.get(k), kind) for k, kind in kinds.items()):
        raise InputError("expected the cases.json of a trial", path, code="wrong_kind")
    return index


def read_labels(folder: Path) -> dict[str, dict[str, Any]]:
    """The sealed labels; raises `InputError` if their SHA-256 differs from the published one."""
    path = folder / LABELS
    if not path.exists():
        raise InputError("found no labels; they were sealed elsewhere", path, code="missing_file")
    text = read_text(path)
    if hashlib.sha256(text.encode()).hexdigest() != read_index(folder)["labels_sha256"]:
        raise InputError("these are not the sealed labels: their SHA-256 differs", path)
    return dict(json.loads(text))
