"""A log of a gyroscope

Body rates alone, from a thing thrown by hand: here with a wheel that spins inside. The balance of angular momentum shows
that something inside turns.
"""

import numpy as np
from picture import SHORT, plt, save

import massprops

seen = massprops.simulate(
    "tracks", frames=200 if SHORT else 400, rates=2e-3, rate=5.0, effects="internal-rotor:8", seed=7
)
rates = seen.sequence.rates
times = (rates.timestamp_ns - rates.timestamp_ns[0]) * 1e-9
record = massprops.sequence_from_arrays(times, rates=rates.w, rate_sigma=2e-3)
found = massprops.diagnose(record)
print(found.verdict, "-", found.reason)
for name, parameters in found.effects.items():
    print(name, {k: v and round(v, 4) for k, v in parameters.items()})

figure, axes = plt.subplots(figsize=(7, 3), constrained_layout=True)
axes.plot(times, np.degrees(rates.w), lw=0.8)
axes.set_xlabel("time [s]")
axes.set_ylabel("body rates [deg/s]")
save(figure)
