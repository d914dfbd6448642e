"""For notebooks and scripts: a study fitted and diagnosed in this process, with tables of pandas and figures.

The commands of the workflow call the same functions; here nothing is kept but simulations.

    import fingerfit

    result = fingerfit.fit("config.yaml", threads=2)
    result.constants
    found = fingerfit.diagnose(result, threads=2)
    better = fingerfit.add(result, found, "tilt")
"""

from fingerfit.notebook.results import Found, Result, add, diagnose, fit, load_result, load_study

__all__ = ["Found", "Result", "add", "diagnose", "fit", "load_result", "load_study"]
