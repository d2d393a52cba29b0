# %% [markdown]
# # An ensemble against an embankment
#
# How often does a block clear the embankment? One release says nothing. This tutorial simulates many releases of a
# scenario and reads the passing frequencies with their 95 % intervals.

# %%
import rock2d

RELEASES = 300  # with each block

scenario = rock2d.load_scenario("scenarios/slope_embankment.yaml")
result = rock2d.run(scenario, engine="point_mass", releases=RELEASES)
passing = result.to_pandas("passing")
print(passing.round(3).to_string(index=False))

# %% [markdown]
# `line_3` stands at the edge of the crest: a block that crosses it clears the embankment. The interval is Wilson's. It
# covers the error of sampling, and nothing else.
#
# First check how the releases ended. A release that ended with `time` was cut off in motion. The column `unresolved`
# counts such releases that had not crossed the line; the interval covers both of what they could have done.

# %%
print(result.to_pandas("stops").groupby(["block", "stop"]).size().to_string())

# %% [markdown]
# How high and with how much energy do they pass? An empty interval means: too few crossings for this percentile.

# %%
percentiles = result.to_pandas("percentiles")
print(percentiles[percentiles["line"] == "line_1"].round(2).to_string(index=False))

# %% [markdown]
# The largest uncertainty is what you assume. Here is the same question with the rigid-body law, which knows the shape
# of the blocks.

# %%
rigid = rock2d.run(scenario, engine="batch", releases=max(RELEASES // 10, 1))
both = rigid.to_pandas("passing").merge(passing, on=["block", "line"], suffixes=("_rigid", "_point"))
print(both[["block", "line", "frequency_rigid", "frequency_point"]].round(3).to_string(index=False))
rigid.plot().savefig("paths.png", dpi=150)
