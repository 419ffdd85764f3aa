"""Lists the packages: `cli/` installs as `massprops_cli`, which pyproject.toml alone cannot say."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["massprops", "massprops.*"]), "massprops_cli"],
    package_dir={"massprops_cli": "cli"},
    package_data={
        "massprops": ["py.typed", "**/*.yaml", "**/*.stl", "**/*.js", "**/*.css", "**/*.html", "**/README.md"]
    },
)
