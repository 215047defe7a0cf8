"""Problems are data, at the same places as the command line has them."""

from __future__ import annotations

import json
import pathlib

import pytest

import maquette
from conftest import SHARED

BAD = SHARED / "graphs/bad"


@pytest.mark.skipif(not BAD.exists(), reason=f"{BAD} is not here")
def test_every_bad_graph_has_its_problems_where_they_are_expected(program) -> None:  # type: ignore[no-untyped-def]
    expected = json.loads((BAD / "expected.json").read_text())
    files = sorted(BAD.glob("*.ron"))
    assert len(files) >= 15
    for file in files:
        with pytest.raises(maquette.GraphError) as wrong:
            maquette.load(file)
        found = wrong.value.problems
        told = json.loads(program("check", str(file), "--json").stdout)["problems"]
        assert [(it.code, it.line, it.column, it.end_line, it.end_column, it.message, it.help) for it in found] == [
            tuple(it[key] for key in ("code", "line", "column", "end_line", "end_column", "message", "help")) for it in told
        ], file.name
        assert all(str(file) in it.text and it.code in it.text for it in found)
        wanted = expected.get(file.name, [])
        wanted = wanted if isinstance(wanted, list) else wanted.get("problems", [])
        for want in wanted:
            lines = want["line"] if isinstance(want["line"], list) else [want["line"]]
            low, high = want["column"]
            at = [it for it in found if it.line in lines and low <= it.column <= high]
            assert any(all(word in it.message + it.help for word in want["words"]) for it in at), (file.name, want, found)


def test_a_mistake_in_a_used_graph_says_by_which_uses_it_is_reached(graphs: pathlib.Path) -> None:
    feature = graphs / "lib/feature.ron"
    feature.write_text(feature.read_text().replace("pick: Rank", "pick: Rang"))
    with pytest.raises(maquette.GraphError) as wrong:
        maquette.load(graphs / "face.ron")
    problem = wrong.value.problems[0]
    assert problem.file.endswith("feature.ron") and "Rang" in problem.text
