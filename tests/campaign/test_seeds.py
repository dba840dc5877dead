from hypothesis import given
from hypothesis import strategies as st

from rvsg.core.seeds import fresh_seeds, seed_for

SEEDS = st.integers(0, 2**63)


@given(SEEDS, st.integers(0, 10_000), st.integers(0, 100))
def test_a_seed_follows_from_purpose_and_index_alone(seed: int, attempt: int, repeat: int) -> None:
    assert seed_for(seed, "search", attempt, repeat) == seed_for(seed, "search", attempt, repeat)
    assert 0 <= seed_for(seed, "search", attempt, repeat) < 2**32


@given(SEEDS, st.integers(1, 40), st.integers(0, 40))
def test_fresh_seeds_are_different_and_none_is_used(seed: int, count: int, taken: int) -> None:
    used = set(fresh_seeds(seed, "confirmation", taken, used=()))  # the very seeds that would come first
    fresh = fresh_seeds(seed, "confirmation", count, used=used)
    assert len(set(fresh)) == count
    assert not used & set(fresh)


def test_purposes_do_not_share_seeds() -> None:
    seeds = {seed_for(0, purpose, index) for purpose in ("brief", "search", "confirmation") for index in range(300)}
    assert len(seeds) == 900
