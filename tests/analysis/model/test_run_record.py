"""A run equals another when everything in it does."""

import polars as pl
import pytest
from pydantic import ValidationError

from analysis.model.run_record import InputFile, Loss, Provenance, Run
from analysis.model.settings import Settings


def run(**changes):
    frames = {
        "aligned": pl.DataFrame({"t_ns": [0, 1], "force_x_N": [1.0, None]}),
        "gate": pl.DataFrame({"t_ns": [0, 1]}),
    }
    provenance = Provenance(
        inputs=(InputFile(name="shift.mcap", sha256="ab", size_bytes=3),),
        settings=Settings(align={"rate_hz": 100.0}),
        losses=(Loss(source="stamps", what="lost"),),
    )
    return Run(**{"frames": frames, "provenance": provenance, **changes})


def test_a_loss_is_one_line_also_where_it_quotes_what_is_none():
    loss = Loss(source="a.bag", topic="/a\nb", what="the first is '\x0b\x00'")
    assert str(loss) == "a.bag /a b: the first is ' �'"


def test_a_run_equals_one_made_alike():
    assert run() == run()
    assert Run({}) == Run({})


@pytest.mark.parametrize(
    "frames",
    [
        {},
        {"aligned": run().frames["aligned"]},
        {"gate": run().frames["gate"], "aligned": run().frames["aligned"]},
        {**run().frames, "gate": pl.DataFrame({"t_ns": [0, 2]})},
        {**run().frames, "gate": pl.DataFrame({"t_ns": [0.0, 1.0]})},
        {**run().frames, "gate": pl.DataFrame({"t_ns": [0]})},
        {**run().frames, "aligned": pl.DataFrame({"t_ns": [0, 1], "force_x_N": [1.0, 0.0]})},
        {
            **run().frames,
            "aligned": pl.DataFrame({"t_ns": [0, 1], "force_x_N": [1.0, float("nan")]}),
        },
        {**run().frames, "aligned": pl.DataFrame({"force_x_N": [1.0, None], "t_ns": [0, 1]})},
    ],
    ids=[
        "no frames",
        "a frame less",
        "another order of frames",
        "another value",
        "another dtype",
        "a row less",
        "null against zero",
        "null against nan",
        "another order of columns",
    ],
)
def test_another_frame_makes_another_run(frames):
    assert run() != run(frames=frames)


def test_another_provenance_makes_another_run():
    assert run() != run(provenance=Provenance())
    assert run() != "a run"


def test_a_run_has_no_hash_and_its_provenance_does_not_change():
    with pytest.raises(TypeError):
        hash(run())
    with pytest.raises(ValidationError):
        run().provenance.t0_unix_ns = 1


def test_provenance_is_plain_json_and_back():
    provenance = run().provenance
    assert Provenance.model_validate_json(provenance.model_dump_json()) == provenance
