"""Name the missing effect

Something brakes the body, so the model of a free rigid body does not fit the tracks. The diagnosis names the effect and its
size. With it, the model also fits data that no fit has seen.
"""

from picture import BLUE, GREY, SHORT, plt, save

import massprops

seen = massprops.simulate("tracks", frames=160 if SHORT else 480, effects="viscous-damping:6", seed=2)
found = massprops.diagnose(seen)
print(found)
print("truth:", seen.truth.facts["effects"])

figure, axes = plt.subplots(figsize=(6, 3.2), constrained_layout=True)
for place, part in enumerate(("fitted", "held_out")):
    before, after = found.gap[part]["before"], found.gap[part]["after"]
    axes.bar(place - 0.18, before, 0.34, color=GREY, label="rigid body alone" if not place else None)
    axes.bar(place + 0.18, after or 0, 0.34, color=BLUE, label="with the effect" if not place else None)
axes.axhline(1, color="k", lw=1, ls="--")
axes.set_yscale("log")
axes.set_xticks((0, 1), ("data fitted", "data held out"))
axes.set_ylabel("residual over noise")
axes.legend()
save(figure)
