"""The results of a run of a scenario, and the folder that `rock2d run` writes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.files.csv_tables import write_csv
from rock2d.files.experiment import Experiment, write_experiment_files
from rock2d.files.folders import atomic_folder
from rock2d.files.scenario import Scenario
from rock2d.progress import Bars
from rock2d.records.columns import STATE_NAMES
from rock2d.runs.acting_effects import true_film
from rock2d.runs.diagnosis_remarks import diagnosis_entry
from rock2d.runs.film_residuals import write_film_residuals
from rock2d.runs.incident_states import IncidentState
from rock2d.runs.simulation import TRAJECTORIES, Simulation

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.graphics.figure_files import Figures

KIND = "run"  # of a folder of results
WRITING = "tables and figure"  # stage of a run


@dataclass(kw_only=True, repr=False)
class RunResult(Simulation):
    """The simulated releases of a scenario; see `Simulation` for tables and plots.

    Attributes
    ----------
    scenario, seed : the scenario and the seed of its random draws
    incident_states : the incident state of each release
    drawn : release -> values drawn for it in addition to its start, see `conditions.Condition`"""

    scenario: Scenario
    seed: int
    incident_states: list[IncidentState] = field(default_factory=list)
    drawn: Mapping[int, Mapping[str, float]] = field(default_factory=dict)

    def experiment(self) -> Experiment:
        """The run as an experiment, like a film of it.

        Blocks that differ from release to release have their own names, for example `boulder_17` for release 17."""
        recording, blocks, rows = self.recording, dict(self.blocks), self.to_pandas(TRAJECTORIES)
        if self.own_blocks:
            named = {t.release: f"{t.block}_{t.release}" for t in self.tracks if t.release in self.own_blocks}
            rows["block"] = rows["release"].map(named).fillna(rows["block"])
            own = {name: replace(self.own_blocks[release], name=name) for release, name in named.items()}
            seen = set(rows["block"].unique())
            blocks = {name: block for name, block in {**blocks, **own}.items() if name in seen}
        return Experiment(
            f"{self.scenario.name}_{self.engine}", self.scenario.gravity_m_s2, recording.fps,
            recording.position_noise_m, recording.angle_noise_rad, self.cross_section, blocks, rows,
        )  # fmt: skip

    def write(
        self,
        folder: str | Path,
        video: bool = False,
        *,
        progress: bool | Bars = False,
        also: Callable[[Path], None] = lambda folder: None,
        figures: Figures | None = None,
    ) -> dict[str, pd.DataFrame]:
        """Write the results folder, completely or not at all.

        The folder is an experiment folder. It also holds a CSV for each indicator (impacts, crossings, passing,
        percentiles, stops, energy) and for the incident states, run.json and trajectories.png; for restarted films also
        residuals.csv, residual_summary.csv, overlay.png, residuals.png and side_by_side.webm.

        Parameters
        ----------
        folder : path
            An earlier result at this place is replaced.
        video : bool
            Also write a video of the first releases of each block, trajectories.webm.
        progress : bool or Bars
            Show progress bars; or the bars of a command of which this is a stage.
        also : callable
            Function that writes further files into the temporary folder before it is renamed.
        figures : Figures, optional
            Determines when figures are drawn; default: at once. See `rock2d.graphics.figure_files`.

        Returns
        -------
        dict of str to pandas.DataFrame
            The written tables by name.

        Raises
        ------
        InputError
            Code ``not_a_result`` if the folder exists and is not a result of rock2d, ``not_writable`` if it cannot be
            written."""
        from rock2d.graphics.figure_files import Figures
        from rock2d.graphics.trajectories import trajectories_figure

        scenario, bars, figures = self.scenario, Bars.of(progress), figures or Figures()
        kept = [name for name in self.table_names() if name != TRAJECTORIES]
        with atomic_folder(folder, KIND) as partial:
            with bars.stage(WRITING, len(kept) + 2, "parts") as bar:
                figures.save(partial / "trajectories.png", trajectories_figure, *self.drawn_paths(self.title))
                bar.step("figure")
                tables = {name: self.to_pandas(name) for name in bar.counted(kept)}
                tables["starts"] = self._incident_states_table()
                if self.drawn:
                    tables["drawn"] = self._drawn_table()
                simulated = self.experiment()
                write_experiment_files(partial, simulated)
                bar.step("trajectories")
            if scenario.experiment is not None:
                tables |= write_film_residuals(
                    true_film(scenario), simulated, self.tracks, partial,
                    slow_motion=scenario.outputs.slowed(max(t.end_s for t in self.tracks)), progress=bars.shown,
                    figures=figures,
                )  # fmt: skip
            for name, table in tables.items():
                write_csv(partial / f"{name}.csv", table)
            text = json.dumps(self._run_json(), indent=2) + "\n"
            (partial / "run.json").write_text(text, encoding="utf-8")
            also(partial)
            if video:
                self.write_video(partial / "trajectories.webm", progress=bars.shown)
            figures.finish()
        return tables

    def write_video(
        self,
        path: str | Path,
        *,
        releases: int | None = None,
        slow_motion: float | None = None,
        progress: bool = False,
        **options: Any,
    ) -> None:
        """Write a video of the first releases of each block, with one scene for each release number.

        Parameters
        ----------
        path : path
            Path with the ending .webm or .mp4.
        releases, slow_motion : optional
            Replace `video_releases` and `slow_motion` of the key `outputs` of the scenario.
        options
            Fields of `rock2d.graphics.video_frames.VideoOptions`, for example `size_px`."""
        from rock2d.graphics.clips import clip_from_track
        from rock2d.graphics.video import render_video
        from rock2d.graphics.video_frames import VideoOptions

        outputs = self.scenario.outputs
        of_block = [[t for t in self.tracks if t.block == name] for name in self.blocks]
        scenes = [
            [
                clip_from_track(tracks[i], body=self.own_blocks.get(tracks[i].release))
                for tracks in of_block
                if i < len(tracks)
            ]
            for i in range(releases or outputs.video_releases)
        ]
        longest = max((clip.t_s[-1] - clip.t_s[0] for scene in scenes for clip in scene), default=0.0)
        options = {"slow_motion": slow_motion or outputs.slowed(longest), "titles": (self.title,), **options}
        with Bars(progress).stage("video", 0, "frames") as bar:
            filled = [[scene] for scene in scenes if scene]
            render_video(path, self.cross_section, self.blocks, filled, ("",), VideoOptions(**options), bar.reach)

    def _run_json(self) -> Mapping[str, Any]:
        from rock2d.version import __version__

        return {
            "scenario": self.scenario.name, "about": self.scenario.about, "assumed": self.scenario.assumed,
            "engine": self.engine, "seed": self.seed, "releases": len(self.tracks), "rock2d": __version__,
            **diagnosis_entry(self.scenario),
        }  # fmt: skip

    def _drawn_table(self) -> pd.DataFrame:
        import pandas as pd

        of_block = {track.release: track.block for track in self.tracks}
        return pd.DataFrame(
            [{"release": release, "block": of_block[release], **drawn} for release, drawn in self.drawn.items()]
        )

    def _incident_states_table(self) -> pd.DataFrame:
        import pandas as pd

        return pd.DataFrame(
            [
                {"release": s.release, "block": s.block, "t_s": s.t_s,
                 **dict(zip(STATE_NAMES, s.state, strict=True)), "frames_fitted": s.frames}
                for s in self.incident_states
            ]
        )  # fmt: skip
