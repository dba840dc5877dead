from hypothesis import given
from hypothesis import strategies as st

from rvsg.app.cli.tables import without_common_beginning


def test_words_that_all_begin_with_are_left_away() -> None:
    assert without_common_beginning(["the work: pick a", "the work: pack"]) == ["pick a", "pack"]
    assert without_common_beginning(["same", "same"]) == ["same", "same"]
    assert without_common_beginning(["alone"]) == ["alone"]
    assert without_common_beginning([]) == []


@given(st.lists(st.text(alphabet="ab ", min_size=1), max_size=5))
def test_what_is_left_is_the_end_of_each_text(texts: list[str]) -> None:
    left = without_common_beginning(texts)
    assert all(text.endswith(end) for text, end in zip(texts, left, strict=True))
    assert len({len(text) - len(end) for text, end in zip(texts, left, strict=True)}) <= 1
