"""Where each paper was published."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reference:
    """Of one paper.

    Attributes:
        journal: with volume and page. doi: empty where none was seen on the paper or its publisher's page.
    """

    authors: str
    title: str
    journal: str
    year: int
    doi: str = ""


REFERENCES = {
    "pesce2017": Reference(
        "V. Pesce, M. Lavagna, R. Bevilacqua",
        "Stereovision-based pose and inertia estimation of unknown and uncooperative space objects",
        "Advances in Space Research 59, 236-251",
        2017,
    ),
    "kabir2025": Reference(
        "R. H. Kabir, X. Bai",
        "Motion and Inertia Estimation for Non-Cooperative Space Objects During Long-Term Occlusion Based on UKF-GP",
        "Sensors 25(3), 647",
        2025,
        "10.3390/s25030647",
    ),
    "volpe2017": Reference(
        "R. Volpe, M. Sabatini, G. B. Palmerini",
        "Pose and Shape Reconstruction of a Noncooperative Spacecraft Using Camera and Range Measurements",
        "International Journal of Aerospace Engineering, 4535316",
        2017,
        "10.1155/2017/4535316",
    ),
    "feng2018": Reference(
        "Q. Feng, Q. Pan, X. Hou, Y. Liu, Z. H. Zhu",
        "Vision-based relative state and inertia ratio estimation of un-cooperative targets",
        "CSME International Congress, Toronto",
        2018,
        "10.25071/10315/35405",  # as the repository of York University has it
    ),
    "hu2024": Reference(
        "Q. Hu, S. Wu, F. Meng, Z. Wu",
        "Relative Motion Estimation Algorithm for Noncooperative Targets Considering Multiple Solutions of "
        "Rotational Parameters",
        "Sensors 24, 1811",
        2024,
        "10.3390/s24061811",
    ),
}
