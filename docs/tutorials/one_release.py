# %% [markdown]
# # One release
#
# One block falls once. You need a block, a cross-section, parameters of the soil, and the state at which the block
# starts: position x and y, angle, velocities and spin.

# %%
import rock2d

cube = rock2d.make_block("cube", "square", mass_kg=0.0233, side_m=0.019)
ground = rock2d.CrossSection(
    points_m=[[-0.70, 0.55], [0.0, 0.0], [0.13, 0.0], [0.18, 0.083], [0.235, 0.083], [0.36, 0.0], [0.6, 0.0]],
    zones=["slope", "ditch", "uphill_face", "crest", "downhill_face", "run_out"],
)
soil = rock2d.ContactParameters(k_l_N_m=1.0e4, k_ul_N_m=6.0e4, friction_angle_deg=30)
state = [-0.05, 0.15, 0.3, 1.0, -1.0, 20.0]  # x_m, y_m, theta_rad, vx_m_s, vy_m_s, omega_rad_s
result = rock2d.simulate(cube, ground, soil, state, engine="batch")

# %% [markdown]
# The result is a set of tables. `impacts` has one row for each impact.

# %%
impacts = result.to_pandas("impacts")
print(impacts[["t_s", "zone", "penetration_m", "force_N"]].round(4).to_string(index=False))
print(result.to_pandas("stops")[["stop", "zone", "runout_m"]].round(3).to_string(index=False))

# %% [markdown]
# The picture shows the ground, the zones and the path of the block. In a notebook the last line of a cell,
# `result`, shows the same.

# %%
result.plot().savefig("path.png", dpi=150)
