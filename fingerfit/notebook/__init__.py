"""For notebooks and scripts: a study fitted and diagnosed in this process, with tables of pandas and figures.

The commands of the workflow call the same functions; here nothing is kept but simulations.

    from fingerfit.notebook import add, diagnose, fit

    result = fit("config.yaml", threads=2)
    result.constants
    found = diagnose(result, threads=2)
    better = add(result, found, "tilt")
"""

from fingerfit.notebook.results import Found, Result, add, diagnose, fit, load_study

__all__ = ["Found", "Result", "add", "diagnose", "fit", "load_study"]
