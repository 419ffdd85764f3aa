"""Inertia ratios from motion alone

A tumbling free body shows the ratios of its moments of inertia. Two filters estimate them while the images come in; the
smoother uses all images at once, at the end. Shaded: three times the 1-sigma errors that the filters state.
"""

from picture import BLUE, RED, SHORT, plt, save

import massprops

seen = massprops.simulate("tracks", frames=120 if SHORT else 400, seed=3)
found = massprops.estimate(seen, method=["smoother", "iekf", "ukf"])
truth = seen.truth.facts
print(f"truth      k1 {truth['k1']:.5f}  k2 {truth['k2']:.5f}")
for one in found:
    print(f"{one.name:<10} k1 {one.k1:.5f}  k2 {one.k2:.5f}  one sigma {one.sigma_k.round(5)}")

figure, panels = plt.subplots(2, 1, figsize=(7, 4.5), sharex=True, constrained_layout=True)
for name, colour in (("iekf", BLUE), ("ukf", RED)):
    one = found[name]
    for k, panel in enumerate(panels):
        value, sigma = one.k_history[:, k], one.k_sigma_history[:, k]
        panel.plot(one.times, value, color=colour, label=name)
        panel.fill_between(one.times, value - 3 * sigma, value + 3 * sigma, color=colour, alpha=0.15, lw=0)
for k, panel in enumerate(panels, 1):
    panel.axhline(truth[f"k{k}"], color="k", lw=1, ls="--")
    panel.set_ylabel(f"k{k}")
    panel.set_ylim(truth[f"k{k}"] - 0.015, truth[f"k{k}"] + 0.015)
panels[0].legend()
panels[1].set_xlabel("time [s]")
save(figure)
