"""The table of a paper

The fast tumble of Pesce, Lavagna and Bevilacqua (2017), with a stereo pair and an iterated Kalman filter. Our numbers are shown
beside those of the paper; the dots are our runs.
"""

from picture import BLUE, SHORT, plt, save

import massprops

found = massprops.reproduce("pesce2017", "C", runs=3 if SHORT else 40)
print(found.text)

figure, panels = plt.subplots(1, 2, figsize=(7, 3), constrained_layout=True)
for panel, name in zip(panels, ("k1", "k2"), strict=True):
    panel.plot(sorted(abs(found.column(name))), "o", color=BLUE, ms=4)
    panel.set_xlabel("run, sorted")
    panel.set_ylabel(f"error of {name}")
save(figure)
