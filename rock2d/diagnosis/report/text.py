"""Texts of the report: the meaning of the numbers of a diagnosis in sentences."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.evidence import NAMED_PROBABILITY
from rock2d.diagnosis.gap import SIGNIFICANT_CELL_Z
from rock2d.diagnosis.model import is_factor
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.cross_section import embankment_facets
from rock2d.wording import listed, number, percent, plus_minus, spoken, three_digits

Tile = tuple[str, str, str]  # a key figure below the verdict: its name, its value, and a note

MOST_POSSIBLE = 5  # listed causes if none can be named
LEAST_PART = 0.1  # smallest share of the gap of an effect that is mentioned together with an unknown cause
# effects that are hard to separate with such data
LOOKALIKES = (
    ("scale_error", "frame_rate_error"),
    ("air_drag", "flight_damping", "out_of_plane"),
    ("viscous_damping", "embankment_yield"),
    ("ploughing_drag", "adhesion"),
    ("soil_compaction", "zone_contrast", "geometry_error"),
    ("mass_eccentricity", "rounded_edges", "angle_offset", "inertia_error"),
)
PHASE_SENTENCES = {
    "impact": "arises in impacts",
    "flight": "arises in flight",
    "rest": "appears where blocks come to rest",
}
HINTS = {  # by the lever of a dependence, see `levers`
    "law": "the law of the soil changes",
    "incident state": "the measured states before impacts are shifted",
    "outcome": "the outcomes of impacts are shifted",
    "flight": "blocks in flight are accelerated",
    "slope": "the ground has another slope than stated",
    "profile": "the ground has another profile than stated",
    "frame": "camera or ground move",
}


def share_closed(value: float | None, ci95: Sequence[float]) -> str:
    """Share of the gap that a model closes, with its interval; `value`: None if it is hardly known."""
    low, high = (round(100 * v) for v in ci95)
    if value is None:
        return f"not known ({low} to {high} %)".replace("-", "−")
    if low == high == 0 and value == 0.0:
        return "nothing"
    text = f"{round(100 * value)} %"
    return (text if low == high else f"{text} ({low} to {high} %)").replace("-", "−")


def plausible_range(parameter: Parameter) -> str:
    """ "0.97 to 1.03", without its unit; angles in degrees."""
    low, high = (in_degrees(parameter, end)[0] for end in (parameter.low, parameter.high))
    return f"{low:.3g} to {high:.3g}".replace("-", "−")


def in_degrees(parameter: Parameter, value: float) -> tuple[float, str]:
    """A value and its unit as shown: angles in degrees, pure numbers without a unit."""
    if parameter.unit == "rad":
        return float(np.rad2deg(value)), "°"
    return value, "" if parameter.unit in ("1", "choice") else parameter.unit


def model_causes(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The causes in the model."""
    return [cause for cause in content.get("causes", []) if cause["closes"] is not None]


def _other_causes(content: Mapping[str, Any], effect: str) -> list[Mapping[str, Any]]:
    """The causes in the model except `effect`."""
    return [cause for cause in model_causes(content) if cause["effect"] != effect]


def learnt(content: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The learnt changes, or None."""
    return (content.get("outside") or {}).get("learnt")


def best_model(content: Mapping[str, Any], chain: Sequence[str]) -> str:
    """What the best model adds to the base law: effects and learnt changes, in words."""
    named = [cause["effect"] for cause in model_causes(content)]
    return listed([*named, *["what was learnt"] * bool(learnt(content))] or chain)


def verdict_sentence(content: Mapping[str, Any]) -> tuple[str, str]:
    """The title of the verdict, and one or two sentences."""
    verdict, faults = content["verdict"], content["sanity"]["faults"]
    if faults:
        film = content.get("film") or {}
        found = f" But its flights say: {film['said'][0]}." if (film.get("gravity") or {}).get("off") else ""
        return "Not diagnosed", f"This experiment is too poor to diagnose: {'; '.join(faults)}.{found}"
    if verdict == "none":
        return "No gap", (
            "The base law (the paper's law with its own parameters refitted) explains these data. Its residuals are "
            "not significantly larger than the noise of the measurement and the scatter of the soil from strike to "
            "strike."
        )
    outside = _outside_sentence(content)
    if verdict == "unknown":
        possible = [c["effect"] for c in content.get("causes", []) if not c.get("named")]
        part = f" Part of the gap closes with {closing}." if (closing := explained_part(content)) else ""
        if possible and not outside:
            return "Unknown cause", (
                "Something acts that the base law does not contain, but these data cannot show what. It may be "
                f"{listed(possible[:MOST_POSSIBLE], 'or')}.{part}"
            )
        return "Unknown cause", (
            "There is a gap between film and simulation, but no effect of the catalogue explains all of it. A cause "
            f"lies outside the catalogue.{part}{_strongest_dependence(content)}"
        )
    effect = catalogue().get(verdict)
    cause = effect.summary if effect else "an effect outside the catalogue"
    origin = f" It comes from the {effect.origin}." if effect else ""
    beside = [cause["effect"] for cause in _other_causes(content, verdict)]
    together = f" Also found: {listed(beside)}." if beside else ""
    rivals = [name for name in content["group"] if name != verdict]
    others = f"{listed(rivals, 'or')}{common_words(content, verdict)}"
    doubt = f" These data cannot separate it from {others}." if rivals else ""
    return (
        spoken(verdict).capitalize(),
        f"This explains {_share_words(content, verdict)}the gap between film and simulation: {cause}."
        f"{origin}{together}{doubt}{outside}",
    )


def _share_words(content: Mapping[str, Any], effect: str) -> str:
    """The share of the gap that an effect explains, as words before "the gap"; "" for all of it."""
    own = next((cause["closes"] for cause in model_causes(content) if cause["effect"] == effect), None)
    if own is not None and _other_causes(content, effect):
        return f"{round(100 * own)} % of "
    return "most of " if _outside_sentence(content) else ""


def common_words(content: Mapping[str, Any], effect: str) -> str:
    """The common quantity of effects that share a name, as words; "" if there is none."""
    own = next((c.get("common") for c in content.get("causes", []) if c["effect"] == effect), None)
    if own is None:
        return ""
    low, high = own["ci95"]
    return f"; both mean {own['name']} = {own['value']:.3f} ({low:.3f} to {high:.3f})"


def _outside_sentence(content: Mapping[str, Any]) -> str:
    """A sentence on a cause outside the catalogue that acts together with the named ones; "" if that is improbable."""
    found = content.get("outside")
    if found is None or found["p"] < NAMED_PROBABILITY:
        return ""
    dependence = f" It depends on the {found['depends_on'][0]}." if found["depends_on"] else ""
    share = round(100 * found["share"])
    part = f", with {share} % of the gap" if share else ""
    return f" Something outside the catalogue acts too (probability {percent(found['p'])}){part}.{dependence}"


def explained_part(content: Mapping[str, Any]) -> str:
    """The effects, with their shares, that close a considerable part of a gap with an unknown cause; "" if there are
    none."""
    parts = [
        f"{spoken(cause['effect'])} ({share_closed(cause['closes'], cause['closes_ci95'])} of the gap)"
        for cause in model_causes(content)
        if cause["closes_ci95"][0] >= LEAST_PART
    ]
    return listed(parts)


def _strongest_dependence(content: Mapping[str, Any]) -> str:
    """A sentence on the strongest remaining dependence, as a hint to an unknown cause."""
    remaining = content.get("unexplained", [])
    if not remaining:
        return ""
    lever, group = remaining[0]["dependence"].split(" of ", 1)
    dependence = f", depending on the {group}" if group != "nothing" else ", equally everywhere"
    return f" The strongest remaining dependence: {HINTS[lever]}{dependence}."


def key_figures(content: Mapping[str, Any], chain: Sequence[str]) -> list[Tile]:
    """The key figures below the verdict; `chain`: effects of the best model."""
    verdict, gap, effects = content["verdict"], content["gap"], catalogue()
    chance = percent(content["probabilities"][verdict])
    tiles = [("Probability", chance, "among the effects of the catalogue, none and unknown")]
    ranked = [name for name in ranking(content) if name != verdict]
    if verdict == "none":
        nearest = content["effects"][ranked[0]]
        gain = plus_minus(nearest["heldout_score_gain"], nearest["heldout_score_gain_se"])
        gained = f"gains {gain} in log likelihood on held-out releases"
        tiles.append(("Gap", f"{gap['base']:.2f}", f"noise and soil alone give {gap['noise_floor']:.2f}"))
        return [*tiles, ("Nearest to an effect", spoken(ranked[0]), gained)]
    closed = share_closed(gap["closure"], gap["closure_ci95"])
    if verdict == "unknown":
        with_it = best_model(content, chain)
        by = (
            f"by the best model, with {with_it}; 95 % interval"
            if with_it
            else "no effect closes a part, and nothing is learnt"
        )
        tiles.append(("Gap closed", closed, by))
        return [*tiles, *_predicted_tile(content), *_place_tile(content)]
    low, high = (round(100 * v) for v in gap["closure_ci95"])
    remark = "no predictable residual remains" if low == high else "95 % interval"
    tiles.append(("Gap closed", closed, f"on held-out releases; {remark}"))
    if len(chain) > 1:
        alone = _closed_by(content, verdict)
        tiles.append(("By this effect alone", alone, f"of the gap, by {spoken(verdict)}"))
    found = [c["effect"] for c in _other_causes(content, verdict)]
    second = next((name for name in ranked if not effects[name].scatter), None)
    if second is not None and second not in found:  # those have tiles of their own
        tiles.append(("Runner-up", _closed_by(content, second), f"of the gap closed by {spoken(second)}"))
    beside = [
        ("Further effect", spoken(c["effect"]), f"closes {share_closed(c['closes'], c['closes_ci95'])}")
        for c in _other_causes(content, verdict)
    ]
    none = ("Second effect", "none needed", "no other effect gains significantly in addition to this one")
    tiles += beside or [none]
    return [*tiles, *_predicted_tile(content), *_size_tile(content, effects[verdict]), *_place_tile(content)]


def _predicted_tile(content: Mapping[str, Any]) -> list[Tile]:
    """The gap that predictions close, for a film; and errors in physical units."""
    tiles = []
    if (own := content.get("predicted")) is not None:
        closed = share_closed(own["typical"]["closure"], own["typical"]["closure_ci95"])
        tiles.append(("Closed by predictions", closed, predicted_words(own)))
    if misses := physical_misses(content):
        (value, where), *others = misses
        further = "".join(f"; {other} {place}" for other, place in others)
        tiles.append(("Misses", value, f"{where}, median of held-out releases without → with it{further}"))
    return tiles


def physical_misses(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Errors of the base law and the best model in physical units, and where they occur."""
    places = {"mm": (" mm", "at the end of a segment"), "deg": ("°", "there"), "m_s": (" m/s", "after an impact")}
    misses = content.get("physical", {})
    return [
        (f"{three_digits(misses[key]['base'])} → {three_digits(misses[key]['augmented'])}{unit}", place)
        for key, (unit, place) in places.items()
        if key in misses
    ]


def predicted_words(own: Mapping[str, Any]) -> str:
    """Errors of predictions of whole segments in words, from the key `predicted`."""
    typical, tail, units = own["typical"], own["tail"], own["units"]
    return (
        f"from one flight to the next, held-out releases: they miss {_in_sigma(typical['base'])} without and "
        f"{_in_sigma(typical['augmented'])} with it (median; {_in_sigma(typical['floor'])} is noise and "
        f"soil), the worst 5 % {_in_sigma(tail['base'])} and {_in_sigma(tail['augmented'])} or more; "
        f"1 σ is {units['mm']:.2g} mm and {units['deg']:.2g}°"
    )


def _in_sigma(value: float) -> str:
    return f"{number(value, abs(value) / 10.0)} σ"


def _closed_by(content: Mapping[str, Any], effect: str) -> str:
    own = content["effects"][effect]
    return share_closed(own["closure"], own["closure_ci95"])


def _size_tile(content: Mapping[str, Any], effect: Effect) -> list[Tile]:
    """The value of the verdict's first parameter."""
    parameter, joint = effect.parameters[0], content.get("beside")
    own = joint[-1]["parameters"][effect.name] if joint else content["effects"][effect.name]["parameters"]
    what = "Choice" if parameter.choices else "Size"
    return [(what, size_words(parameter, own[parameter.name]), parameter.meaning)]


def size_words(parameter: Parameter, own: Mapping[str, Any]) -> str:
    """A fitted parameter with its unit; a factor as a change in %; the smallest and the largest if blocks differ."""
    if of_blocks := own.get("by_block"):
        values = sorted(of_blocks.values(), key=lambda one: float(one["value"]))
        return " to ".join(size_words(parameter, one) for one in (values[0], values[-1]))
    if parameter.choices:
        return parameter.choice_name(own["value"]) or f"{own['value']:g}"
    value, unit = in_degrees(parameter, own["value"])
    low, high = (in_degrees(parameter, v)[0] for v in own["ci95"])
    if is_factor(parameter):
        value, low, high, unit = 100.0 * (value - 1.0), 100.0 * low, 100.0 * high, "%"
    sign = "+" if is_factor(parameter) and value > 0.0 else ""
    return sign + number(value, 0.5 * (high - low)) + (unit if unit == "°" else f" {unit}" if unit else "")


def _place_tile(content: Mapping[str, Any]) -> list[Tile]:
    """The place with the largest share of the gap."""
    if not has_significant_place(content):
        return []
    zone, of_zone = largest_share(content["where"], "zone")
    phase, of_phase = largest_share(content["where"], "phase")
    note = f"{100 * of_zone:.0f} % of the gap lies there; {100 * of_phase:.0f} % {PHASE_SENTENCES[phase]}"
    return [("Where", spoken(zone), note)]


def ranking(content: Mapping[str, Any]) -> list[str]:
    """Tried effects, sorted by probability, then by gain."""
    tried = [name for name in content["effects"] if name in catalogue()]
    gains, chances = content["effects"], content["probabilities"]
    return sorted(tried, key=lambda n: (-round(chances[n], 6), -gains[n]["heldout_score_gain"]))


def where_sentence(content: Mapping[str, Any]) -> str:
    """A sentence: where most of the gap lies."""
    cells = content["where"]
    if not has_significant_place(content):
        return "No place stands out: the residuals are nowhere significantly larger than noise and soil explain."
    phase, of_phase = largest_share(cells, "phase")
    zone, of_zone = largest_share(cells, "zone")
    block, of_block = largest_share(cells, "block")
    text = f"{100 * of_phase:.0f} % of the gap {PHASE_SENTENCES[phase]}. "
    text += f"The {spoken(zone)} has {100 * of_zone:.0f} % of it"
    if len({cell["block"] for cell in cells}) > 1:
        text += f", the {spoken(block)} {100 * of_block:.0f} %"
    return f"{text}."


def has_significant_place(content: Mapping[str, Any]) -> bool:
    """Whether the gap is significant in any place."""
    return content["verdict"] != "none" and any(cell["z"] >= SIGNIFICANT_CELL_Z for cell in content["where"])


def largest_share(cells: Sequence[Mapping[str, Any]], key: str) -> tuple[str, float]:
    """The phase, zone, block or channel with the largest share of the gap, and that share."""
    sums: dict[str, float] = {}
    for cell in cells:
        sums[cell[key]] = sums.get(cell[key], 0.0) + cell["share"]
    name = max(sums, key=lambda n: sums[n])
    return name, sums[name]


def assumptions(result: Diagnosis, content: Mapping[str, Any], chain: Sequence[str]) -> list[str]:
    """The assumptions of the diagnosis, in sentences."""
    cross_section = result.experiment.cross_section
    fitted = " It is refitted to these data before any effect is tried." if content["law"]["fitted"] else ""
    lines = [
        "The base law is the paper's contact law (elasto-plastic normal spring, tangential spring that slips, rolling "
        "spring) with one set of parameters for all zones." + fitted,
        *content.get("assumptions", []),
    ]
    if isinstance(result.data, FilmData):
        lines += [
            "A release is divided into flights. Everything between two flights counts as one impact, which is "
            "predicted from the measured flight before it. In flight only gravity acts, unless an effect adds a force.",
            "The noise of the camera is normal. It is estimated from the flights, not taken from experiment.yaml. The "
            "scatter of the soil from strike to strike is fitted by maximum likelihood.",
            "The position of the camera's axis is not stated. Effects that distort the image assume that it points at "
            "ditch and embankment, and fit its distance from there. So do effects that turn or scale the image, for "
            "the point that stays in its place.",
        ]
    else:
        lines.append(
            "Each row of the table is one impact, simulated from the state before it. The noise of the velocities is "
            "not stated; it is fitted together with the scatter of the soil. On hard ground the data determine only "
            "the ratios of the stiffnesses."
        )
    lines.append(
        "Releases are numbered in the order filmed, and the series of each block begins on fresh ground. Effects that "
        "grow from release to release depend on that order."
    )
    raised = {zone for zone, part in zip(cross_section.zones, embankment_facets(cross_section), strict=True) if part}
    if raised:
        zones = listed([zone for zone in cross_section.zone_names if zone in raised])
        lines.append(
            f"The embankment is recognised by its shape, not by its name: {zones}."
            if len(cross_section.embankments) == 1
            else f"The embankments are recognised by the numbers of their zones: {zones}."
        )
    else:
        lines.append("This cross-section has no embankment, so effects of an embankment cannot appear.")
    lines.append(
        "An effect is tested on held-out releases, but all releases come from one set-up and one camera. The "
        "probabilities compare only the effects of the catalogue, none and unknown."
    )
    groups = lookalikes(chain, list(content["effects"]))
    if groups:
        lines.append("Hard to separate even with good data: " + "; ".join(groups) + ".")
    return lines


def unseen_words(content: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """Reason why effects cannot be seen -> the effects, as pairs."""
    unseen = content.get("unseen") or {}
    return [(why, [name for name in unseen if unseen[name] == why]) for why in dict.fromkeys(unseen.values())]


def lookalikes(names: Sequence[str], known: Sequence[str]) -> list[str]:
    """Groups of effects that are hard to separate, in words; first those with one of `names`."""
    groups = [[name for name in group if name in known] for group in LOOKALIKES]
    groups = [group for group in groups if len(group) > 1]
    return [listed(group) for group in sorted(groups, key=lambda g: not set(g) & set(names))]
