"""Tables of a notebook where there is nothing to show."""

from types import SimpleNamespace

from fingerfit.notebook.results import Found


def test_candidates_are_an_empty_table_where_nothing_was_tried():
    score_test = SimpleNamespace(misfit=10.0, freedom=10, beyond_noise=1.0)
    found = Found(SimpleNamespace(score_test=score_test, ranking=[], refits={})).candidates
    assert found.empty
    assert (found.index.name, list(found.columns)) == (
        "effect",
        ["family", "explained", "log_odds", "refitted", "explained_by_refit"],
    )
