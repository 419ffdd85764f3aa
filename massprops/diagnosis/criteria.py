"""Every threshold of the verdict, and what it was set on."""

BEATS_NOTHING = 5.0
"""Log evidence by which a hypothesis must beat the plain rigid body: 'very strong' in Kass and Raftery's scale (1995),
and as much again as the logarithm of the catalogue's size."""
BEATS_UNKNOWN = 1.0
"""Log evidence by which an effect beside a latent torque must beat that torque alone: it is simply more likely. Set on
drag in the odd racquets, where the two differed by 1 to 11; with noise by sample it is 30 to 50."""
ALIKE = 5.0
"""Log evidence within which two effects are not told apart."""
PART_LEFT = 0.5
"""Part of the misfit (rms, beyond a stated noise) that an effect may leave by itself: more is unexplained. A half of the misfit
is three quarters of its square. Odd flights and racquets: 0.01 to 0.3. A weak misfit, 1.30 of the noise with 1.04 left, is a sliding
mass's; of 25 spent records with less than 2.6 no other verdict depends on that the noise is taken off."""
FOLLOWED = 0.5
"""Part of the log evidence that an effect which is enough by itself gains over the free body, short of which another one is not followed
to its end. In 31 spent records what had half of it gained .08 of it at most from a few passes on, and .03 by being moved to its best. Masses
on springs gain more from a few passes on: four of their starts are fitted to the end in any case."""
LEFT_OF_STATED = 1.25
"""Residual over the stated noise that an effect may leave by itself. Set on bodies moved by Basilisk and MuJoCo: effects
that acted left 0.97 to 1.14, an impulse in place of a boom that swings the body 1.58."""
SIGNIFICANT = 1e-3
"""Chance of parameters so far from nothing (Wald's test, jointly) up to which an effect is named."""
SHOWN = 2.0
"""Sigmas that a parameter must stand from zero to be printed."""
DISAGREE = -10.0
"""Log evidence that records lose when they share an inertia, from which they are said not to be of one body. The odd
flights of one body gain 24 and 38."""
TURNED = 10.0
"""Log evidence by which several records must be likelier with their sensors' axes turned in the body from record to record, as much as
`DISAGREE`. Four odd racquets gain 245. In 36 made-up sets of three records where nothing slips the gain is 9.3 at most, -0.2 in the median; the odd
flights of one body gain -0.3 to 0.2."""
LEAST_SHARE = 0.002
"""Of the sum of moments that a second moment of mass keeps before and after a change of inertia: a disk 20 times as wide as
thick."""
MOST_GROWN = 5.0
"""By how much the moments of inertia may grow or shrink in all when something deploys or lets go."""
LEAST_TURN = 0.5
"""Turn over a record [rad] below which free rotation cannot be told from anything else."""
MOST_TURN = 60.0
"""Turn over a record [rad] above which rates alone go by the search over starts: a bias of the gyroscope, which the balance
does not hold, would turn the path too far. The throws it was tried on turn by 5 to 18."""
FOLDS = 4
BLOCKS = 20
"""Parts in time of a record at most; every fourth is held out in turn."""
FEWEST_IN_BLOCK = 3
FEWEST_HELD = 24
"""Measurements below which nothing is held out, and so nothing named: two parts for each fold."""
SHAPE_SD = 1.5
"""Prior of the logarithms of second moments: bodies up to 20 times as long as thick lie within two of it."""
SCALE_SD = 0.005
"""Prior of a gyroscope's scale and misalignment: between data sheets of raw ones (1 to 3 %) and calibrated ones (0.1 %)."""
SCALES = (0.001, 0.002)
"""Smaller such priors, of which the smallest that is as likely as any (`ALIKE`) is taken where an effect is named from rates alone: a
record hardly tells them apart, and a larger one lets the inertia go. With the likeliest k1 of two racquets of eight was off by .09 and
.11, with the smallest of these all are within .05; one flight of 14 is likelier by more with 0.002. All were looked at. Larger ones
than 0.005 are left out: with 0.01 or 0.02 the sensor took up a part of what drag leaves, and k1 went from -2.5 to -2.4."""
OFFSET_SD = 0.01
"""Prior of the offset of a gyroscope beside attitudes [rad/s]: a phone's, and far more than a spacecraft's."""
CLOCK_SD = 0.1
"""Prior of a gyroscope's clock against that of the attitudes beside it [s]: an exposure, a bus, a filter."""
WIDE = 10.0
"""Prior of momenta at the start over those of the mean moment: no word at all."""
AXIS_SD = 0.3
"""Prior of a wheel's axis about the one that the balance across it shows [rad]."""


def followed_from(free: float, likeliest: float) -> float:
    """Log evidence short of which an effect, or a pair, is not followed to its end: `FOLLOWED` of the way from the free body's to the
    likeliest one's."""
    return free if likeliest < free else (1.0 - FOLLOWED) * free + FOLLOWED * likeliest
