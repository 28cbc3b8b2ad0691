"""
A simulated gripper that feels slip
===================================

Two soft pads hold a ball in MuJoCo while a growing force pulls it down. One pad has taxels: its readings are computed from the simulator's
contact forces, and a tracker and a grasp monitor process them as on a robot. The monitor does not know the friction. When the rim of the contact
begins to slip, the gripper tightens its grip. Without touch the same grip loses the ball.
"""

# sphinx_gallery_thumbnail_number = 1
import matplotlib.pyplot as plt
import mujoco
import numpy as np

import palpate as pp
from palpate.mujoco import Taxels

SCENE = """
<mujoco>
  <option timestep="0.001" cone="elliptic" impratio="100" gravity="0 0 0"/>
  <default><geom friction="0.6 0.005 0.0001" condim="3"/></default>
  <worldbody>
    <body name="left" pos="-0.0131 0 0">
      <joint name="left" type="slide" axis="1 0 0" damping="5"/>
      <geom name="left" type="box" size="0.001 0.012 0.012" mass="0.05"/>
      <site name="skin" pos="0.001 0 0" euler="0 -90 0"/>
    </body>
    <body name="right" pos="0.0131 0 0">
      <joint name="right" type="slide" axis="-1 0 0" damping="5"/>
      <geom name="right" type="box" size="0.001 0.012 0.012" mass="0.05"/>
    </body>
    <body name="ball"><freejoint/><geom name="ball" type="sphere" size="0.012" mass="0.02"/></body>
  </worldbody>
  <actuator><motor joint="left"/><motor joint="right"/></actuator>
</mujoco>"""

# %%
# The skin is a soft pad with 12 x 12 taxels of three components, with noise.

array = pp.AreaArray(
    shape=(12, 12), pitch=1.2e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=60.0
)
skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)

# %%
# The pull grows to 1.6 N in two seconds. Friction on each pad bears 0.6 times the grip force, so a grip of 1 N loses the ball at 1.2 N.


def hold(feels: bool) -> dict[str, list[float]]:
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    taxels = Taxels(model, skin, geom="left", site="skin")
    tracker, monitor = skin.track(), pp.GraspMonitor(incipient=0.7)
    rng = np.random.default_rng(0)
    grip, log = 1.0, {"time": [], "grip": [], "pull": [], "fallen": [], "used": []}
    for step in range(2400):
        pull = 1.6 * np.clip((step - 400) / 2000, 0.0, 1.0)
        data.ctrl[:] = grip
        data.xfrc_applied[3, 2] = -pull
        mujoco.mj_step(model, data)
        if step % 20 == 0:
            touch = tracker.step(taxels.read(data, rng=rng), time=step / 1000)
            monitor.update(touch)
            used = monitor.state.utilisation
            if feels and step >= 400 and used > 0.7:
                grip *= 1.05
            for name, value in zip(log, (step / 1000, grip, pull, -1e3 * data.qpos[4], used)):
                log[name].append(float(value))
    return log


runs = {"without touch": hold(False), "with touch": hold(True)}
for name, log in runs.items():
    print(f"{name}: grip {log['grip'][0]:.1f} to {log['grip'][-1]:.1f} N, the ball sank by {log['fallen'][-1]:.2f} mm")

# %%

figure, axes = plt.subplots(3, 1, figsize=(6.5, 6), sharex=True, layout="constrained")
for name, log in runs.items():
    axes[0].plot(log["time"], log["grip"], label=f"grip, {name}")
    axes[1].plot(log["time"], log["used"], label=name)
    axes[2].plot(log["time"], log["fallen"], label=name)
axes[0].plot(log["time"], log["pull"], "k:", label="pull")
axes[0].set_ylabel("force (N)")
axes[1].set_ylabel("part of the friction used")
axes[2].set_ylabel("ball sank by (mm)")
axes[2].set_ylim(-0.2, 5)
axes[2].set_xlabel("time (s)")
for ax in axes:
    ax.legend(loc="upper left")
assert runs["with touch"]["fallen"][-1] < 1.0 < 5.0 < runs["without touch"]["fallen"][-1]
plt.show()
