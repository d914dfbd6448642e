"""Puts what lies beside the package in a clone inside of it; all else about the package is in pyproject.toml."""

from setuptools import find_packages, setup

# the package `fingerfit.shipped` is the root of the project as far as an installed one needs it, see core/folders.py
SHIPPED = ["Snakefile", "config.yaml", "workflow/**", "templates/**"]
STUDIES = ["phantom", "hidden-tilt", "hidden-inclusion"]

setup(
    packages=[*find_packages(include=["fingerfit*"]), "fingerfit.shipped"],
    package_dir={"fingerfit.shipped": "."},
    package_data={"fingerfit.shipped": [*SHIPPED, *(f"studies/{name}/**" for name in STUDIES)]},
    include_package_data=False,
)
