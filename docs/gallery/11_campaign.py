"""Many runs at once

How does the error of the inertia ratios grow with the noise of the tracks? This campaign runs one estimator
on a grid of noise levels, with several seeds each. Runs that fail become rows with the reason.
"""

import numpy as np
from picture import BLUE, SHORT, plt, save

import massprops

noises = [0.1, 1.0] if SHORT else [0.1, 0.3, 1.0, 3.0]
study = {
    "kind": "estimate",
    "runs": 2 if SHORT else 12,
    "frames": 150,
    "estimator": "momentum-ls",
    "grid": {"sigma_px": noises},
}
found = massprops.campaign(study)
print(found)
errors = [
    np.array([abs(r["k1_error"]) for r in found.rows if r["sigma_px"] == n and r.get("k1_error") is not None])
    for n in noises
]
for noise, error in zip(noises, errors, strict=True):
    print(f"{noise:4.1f} px: {len(error)} of {study['runs']} runs show k1, median error {np.median(error):.2g}")

figure, axes = plt.subplots(figsize=(6, 3.5), constrained_layout=True)
for noise, error in zip(noises, errors, strict=True):
    axes.loglog(np.full(len(error), noise), error, "o", color=BLUE, alpha=0.5)
axes.set_xlabel("noise of the tracks [px]")
axes.set_ylabel("error of k1")
save(figure)
