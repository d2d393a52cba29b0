"""The smallest case that still shows a fault: fewer points, fewer soils, simpler numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rock2d.scene.cross_section import CrossSection, CrossSectionError
from tests.hunt.cases import Case, Site
from tests.hunt.releases import Finding, check

KEPT = 0.3  # share of the fault's size that a smaller case must show


def shrunk(finding: Finding) -> Finding:
    """The finding with its case as small as it gets while the fault stays."""
    smaller = True
    while smaller:
        smaller = False
        for case in _simpler(finding.case):
            same = [
                f
                for f in check([case.site], [case.state[None]])
                if f.fault == finding.fault and f.size > KEPT * finding.size
            ]
            if same:
                finding, smaller = same[0], True
                break
    return finding


def _simpler(case: Case) -> Iterator[Case]:
    site = case.site
    ground = site.cross_section
    for i in range(len(ground.points_m)):
        points, zones = np.delete(ground.points_m, i, axis=0), list(ground.zones)
        del zones[min(i, len(zones) - 1)]
        try:
            yield Case(replace(site, cross_section=CrossSection(points, zones)), case.state)
        except CrossSectionError:
            continue
    names = ground.zone_names
    for kept in names if len(names) > 1 else ():
        one = CrossSection(ground.points_m, [kept] * len(ground.zones))
        yield Case(replace(site, cross_section=one, soils={kept: site.soils[kept]}), case.state)
    for name, law in site.soils.items():
        for key, plain in (
            ("k_r_Nm_rad", 0.0), ("rolling_cap", False), ("rolling_in_indentation", False), ("k_t_N_m", 0.0),
        ):  # fmt: skip
            if getattr(law, key) != plain:
                soils = {**site.soils, name: replace(law, **{key: plain})}
                yield Case(Site(site.block, site.sizes, ground, soils), case.state)
