"""
A small network, trained on the simulator
=========================================

A neural network learns force and place of a press from simulated readings, and is compared with the reconstruction by the same skin. For contacts like
those of its training it is nearly as accurate, and much faster. For other contacts it gives wrong results without a warning; the reconstruction assumes
no shape, and gives an interval.
"""

# sphinx_gallery_thumbnail_number = 1
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import palpate as pp

pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
array = pp.AreaArray(shape=(6, 6), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=500.0)
skin = pp.Skin(pad, array, nuisance=[])  # this sensor does not drift
rng = np.random.default_rng(0)

# %%
# Presses
# -------
# Two thousand balls: readings with the noise of the array, and true force and place.


def balls(count, rng):
    truth = np.stack([rng.uniform(0.3, 3.0, count), *rng.uniform(-3e-3, 3e-3, (2, count))], axis=-1)
    traction = [
        skin.sample(pp.solutions.hertz_point(contact_radius=rng.uniform(1.5e-3, 3e-3), force=force).shifted(x, y))
        for force, x, y in truth
    ]
    return skin.sense(np.stack(traction), rng=rng), truth


readings, truth = balls(2000, rng)
scale = np.array([1.0, 1e-3, 1e-3])  # newtons, millimetres
inputs, targets = jnp.asarray(readings.reshape(len(readings), -1) / 1e4), jnp.asarray(truth / scale)

# %%
# A network of one hidden layer
# -----------------------------
# It is trained by Adam (D. P. Kingma, J. Ba, 2015).


def network(weights, x):
    return jnp.tanh(x @ weights["w1"] + weights["b1"]) @ weights["w2"] + weights["b2"]


def loss(weights, x, y):
    return jnp.mean((network(weights, x) - y) ** 2)


@jax.jit
def step(weights, first, second, count):
    slope = jax.grad(loss)(weights, inputs, targets)
    first = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, first, slope)
    second = jax.tree.map(lambda v, g: 0.999 * v + 0.001 * g**2, second, slope)
    rate = 5e-3 * jnp.sqrt(1 - 0.999**count) / (1 - 0.9**count)
    return jax.tree.map(lambda w, m, v: w - rate * m / (jnp.sqrt(v) + 1e-8), weights, first, second), first, second


weights = {
    "w1": jnp.asarray(rng.standard_normal((36, 64)) / 6),
    "b1": jnp.zeros(64),
    "w2": jnp.asarray(rng.standard_normal((64, 3)) / 8),
    "b2": jnp.zeros(3),
}
first = second = jax.tree.map(jnp.zeros_like, weights)
for count in range(1, 1501):
    weights, first, second = step(weights, first, second, count)
print(f"trained to {float(loss(weights, inputs, targets)) ** 0.5:.3f} (N, mm)")


def learned(readings):
    return np.asarray(network(weights, jnp.asarray(readings.reshape(len(readings), -1) / 1e4)))[:, 0]


# %%
# Comparison with the reconstruction
# ----------------------------------
# The tests are new balls, and contacts unlike those of the training: two balls at once, and a flat stamp.

unseen, unseen_truth = balls(24, np.random.default_rng(1))
other, other_truth = [], []
rng = np.random.default_rng(2)
for i in range(24):
    if i % 2:
        contacts = [
            pp.solutions.hertz_point(contact_radius=1.5e-3, force=f).shifted(x, 0.0)
            for f, x in zip(rng.uniform(0.3, 1.5, 2), (-3.5e-3, 3.5e-3))
        ]
    else:
        contacts = [pp.solutions.patch(half_widths=(4e-3, 3e-3), traction=rng.uniform(1e4, 5e4))]
    other.append(sum(skin.sense(c) for c in contacts) + array.sample_noise(rng, ()))
    other_truth.append(sum(c.force[2] for c in contacts))
other, other_truth = np.stack(other), np.array(other_truth)

figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.4), sharey=True, layout="constrained")
for ax, title, given, force in (
    (axes[0], "balls, as trained", unseen, unseen_truth[:, 0]),
    (axes[1], "pairs and stamps, never seen", other, other_truth),
):
    touch = skin.reconstruct(given)
    low, high = (np.asarray(end)[:, 2] for end in touch.interval(0.95, "force"))
    found, guess = np.asarray(touch.force)[:, 2], learned(given)
    ax.plot([0, 4], [0, 4], color="0.7", lw=0.8)
    ax.errorbar(
        force,
        found,
        [np.maximum(found - low, 0), np.maximum(high - found, 0)],
        fmt="o",
        ms=3,
        lw=0.8,
        label="inversion, 95 %",
    )
    ax.plot(force, guess, "x", ms=5, color="tab:orange", label="network")
    ax.set(title=title, xlabel="true force [N]", ylim=(0, 4.5))
    held = np.mean((low <= force) & (force <= high))
    print(
        f"{title}: network off by {np.mean(np.abs(guess / force - 1)):.0%}, inversion by {np.mean(np.abs(found / force - 1)):.0%}; intervals hold {held:.0%}"
    )
axes[0].set_ylabel("answer [N]")
axes[0].legend(frameon=False)
plt.show()
