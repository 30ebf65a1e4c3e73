"""Blocks in flight with made-up workers that die when told to: every block is answered once, whoever dies."""

from __future__ import annotations

import threading
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.datasets import Picture, UnreadablePicture
from blurnoise_eval.grid.conditions import Cell
from blurnoise_eval.sweep import flight
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.crews import Crew
from blurnoise_eval.sweep.engines import staying
from blurnoise_eval.sweep.flight import IN_FLIGHT, WorkerDied, fly, fly_once
from blurnoise_eval.sweep.lookahead import AHEAD, AHEAD_OF_WORKER, Lookahead
from blurnoise_eval.sweep.work import Work

from blurnoise import Camera

Dies = Callable[["Worker", Block], bool]


class Death(Exception):
    pass


class Worker:
    """A thread that computes its blocks in their order until it dies. alone: whether it had nothing else to do."""

    def __init__(self, crew: MadeCrew, number: int) -> None:
        self.crew, self.number, self.alone = crew, number, True
        self.opened: Future[None] = Future()
        self._todo = SimpleQueue[tuple[Block, Future[Any]] | None]()
        self._waiting = 0
        self._thread = threading.Thread(target=self._live, daemon=True)
        if number not in crew.never:
            self._thread.start()

    def compute(self, block: Block) -> Future[Any]:
        future: Future[Any] = Future()
        self._waiting += 1
        self.crew.most_waiting = max(self.crew.most_waiting, self._waiting)
        self._todo.put((block, future))
        return future

    def dismiss(self) -> None:
        self._todo.put(None)
        self.crew.dismissed.append(self.number)

    def _live(self) -> None:
        if self.number in self.crew.stillborn:
            self.opened.set_exception(Death())
            return
        self.opened.set_result(None)
        dead = False
        while (given := self._todo.get()) is not None:
            block, future = given
            self.alone = self._waiting == 1
            dead = dead or self.crew.dies(self, block)
            self._waiting -= 1
            if dead:
                future.set_exception(Death())
            else:
                future.set_result(([(self.number, block)], self.crew.warned))


class MadeCrew(Crew):
    """Of so many workers; ``dies(worker, block)`` says whether one dies on a block. stillborn: those that die before
    they are ready; never: those that are not to be had."""

    name = "made"

    def __init__(self, size: int, dies: Dies = lambda worker, block: False) -> None:
        super().__init__()
        self._size, self.dies = size, dies
        self.begun = self.most_waiting = 0
        self.dismissed: list[int] = []
        self.stillborn, self.never = set[int](), set[int]()
        self.warned: list[tuple[str, type[Warning]]] = []

    @property
    def size(self) -> int:
        return self._size

    def begin(self) -> Worker:
        self.begun += 1
        return Worker(self, self.begun - 1)

    def is_death(self, error: BaseException) -> bool:
        return isinstance(error, Death)


def block(picture: str, number: int = 0) -> Block:
    made = Picture(picture, None, lambda: np.zeros((1, 1, 3), np.uint8), picture)
    return Block(made, (Cell(picture, number, None, number),))


def flown(crew: MadeCrew, blocks: list[Block]) -> tuple[list[Block], dict[str, UnreadablePicture], list[str]]:
    """Blocks with results, pictures given up, pictures on which workers died."""
    done, given_up, deaths = list[Block](), dict[str, UnreadablePicture](), list[str]()
    answered = Counter[Block]()
    for each, answer in fly_once(crew, blocks):
        if isinstance(answer, WorkerDied):
            deaths.append(each.picture.name)
            continue
        answered[each] += 1
        if isinstance(answer, UnreadablePicture):
            given_up[each.picture.name] = answer
        else:
            assert isinstance(answer, list)
            assert answer[0][1] == each  # type: ignore[index]
            done.append(each)
    assert answered == Counter(blocks)
    assert sorted(crew.dismissed) == list(range(crew.begun))
    return done, given_up, deaths


@pytest.mark.parametrize("size", [1, 2, 7])
def test_every_block_is_answered_once(size: int) -> None:
    crew = MadeCrew(size)
    blocks = [block("a", number) for number in range(30)]
    done, given_up, deaths = flown(crew, blocks)
    assert len(done) == 30
    assert not given_up
    assert not deaths
    assert crew.begun == size
    assert crew.most_waiting <= IN_FLIGHT


@pytest.mark.parametrize("size", [1, 2, 5])
def test_workers_that_die_once_cost_nothing(size: int) -> None:
    """Every third block kills whoever computes it first: others take their places, nothing is lost or twice."""
    killed = set[Block]()

    def dies(worker: Worker, block: Block) -> bool:
        first = block.cells[0].repeat % 3 == 1 and block not in killed
        killed.add(block)
        return first

    crew = MadeCrew(size, dies)
    done, given_up, deaths = flown(crew, [block(f"{number % 4}", number) for number in range(30)])
    assert len(done) == 30
    assert not given_up
    assert len(deaths) == 10
    assert size + 10 - 1 <= crew.begun <= size + 10  # with the last death there may be nothing left to do


@pytest.mark.parametrize("size", [1, 2, 5])
def test_a_picture_that_kills_twice_is_given_up(size: int) -> None:
    """The second time nothing else is in flight on its worker; blocks that were beside it come back."""
    alone = list[bool]()

    def dies(worker: Worker, block: Block) -> bool:
        if block.picture.name == "deadly":
            alone.append(worker.alone)
        return block.picture.name == "deadly"

    blocks = [block("deadly" if number == 4 else f"{number}", number) for number in range(20)]
    crew = MadeCrew(size, dies)
    done, given_up, deaths = flown(crew, blocks)
    assert len(done) == 19
    assert list(given_up) == ["deadly"]
    assert "deadly: the worker that computed it died, and so did the next one" in str(given_up["deadly"])
    assert deaths == ["deadly", "deadly"]
    assert len(alone) == 2
    assert alone[-1]


def test_of_a_picture_given_up_little_else_is_tried() -> None:
    """Many blocks of it, of which each would kill: those in flight may, those in the queue do not."""
    crew = MadeCrew(2, lambda worker, block: block.picture.name == "deadly")
    blocks = [block("deadly", number) for number in range(2)] + [block(f"{n}", n) for n in range(8)]
    done, given_up, deaths = flown(crew, blocks)
    assert len(done) == 8
    assert list(given_up) == ["deadly"]
    assert 2 <= len(deaths) <= 4


def test_the_next_pictures_are_not_blamed() -> None:
    """Blocks that waited on a worker that died are not tried alone, and not suspected."""
    seen = Counter[str]()

    def dies(worker: Worker, block: Block) -> bool:
        seen[block.picture.name] += 1
        return block.picture.name.startswith("deadly")

    blocks = [block(f"deadly {n}" if n % 2 else f"{n}", n) for n in range(8)]
    done, given_up, _ = flown(MadeCrew(1, dies), blocks)
    assert len(done) == 4
    assert len(given_up) == 4
    assert all(count == 2 for name, count in seen.items() if name.startswith("deadly"))


def test_a_worker_that_cannot_be_had_is_missed_by_nobody() -> None:
    """One of two dies, and there is no core for another: the run goes on with one, the suspect included."""
    crew = MadeCrew(2, lambda worker, block: worker.number == 0 and block.cells[0].repeat > 5)
    crew.never = set(range(2, 99))
    done, given_up, deaths = flown(crew, [block(f"{number}", number) for number in range(40)])
    assert len(done) == 40
    assert not given_up
    assert len(deaths) <= 1  # the second one may have done it all


def test_without_any_worker_it_ends_with_an_error() -> None:
    crew = MadeCrew(2)
    crew.never, crew.patience_s = {0, 1}, 0.05
    with pytest.raises(
        ChildProcessError, match=r"engine = 'made': no worker could be had for 0.05 s; what was"
    ):
        list(fly(crew, [block("a")]))
    crew = MadeCrew(1, lambda worker, block: block.picture.name == "b")
    crew.never, crew.patience_s = {1}, 0.05
    flying = fly_once(crew, [block("a"), block("b"), block("c")])
    assert isinstance(next(flying)[1], list)
    assert isinstance(next(flying)[1], WorkerDied)
    with pytest.raises(ChildProcessError, match="no worker could be had"):
        next(flying)


def test_workers_that_never_open_end_it_or_are_done_without() -> None:
    crew = MadeCrew(2)
    crew.stillborn = set(range(99))
    with pytest.raises(ChildProcessError, match=r"died before they had opened the models"):
        list(fly(crew, [block("a")]))
    assert crew.begun <= 4
    crew = MadeCrew(1)
    crew.stillborn = {0, 1}
    assert len(flown(crew, [block("a")])[0]) == 1


def test_a_patient_crew_asks_again_until_its_patience_ends() -> None:
    """More often than one without: a cluster may offer a node that it has lost."""
    crew = MadeCrew(1)
    crew.stillborn, crew.patience_s = set(range(4)), 60.0
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(flight, "_PAUSE_S", 0.01)
        assert len(flown(crew, [block("a")])[0]) == 1
        crew = MadeCrew(1)
        crew.stillborn, crew.patience_s = set(range(999)), 0.1
        with pytest.raises(ChildProcessError, match="no worker could be had"):
            list(fly(crew, [block("a")]))


def test_what_a_worker_raises_is_an_answer_and_what_opening_raises_is_raised() -> None:
    class Raising(MadeCrew):
        def is_death(self, error: BaseException) -> bool:
            return False

        def raised(self, error: BaseException) -> BaseException:
            return ValueError("cause")

    answers = [answer for _, answer in fly_once(Raising(1, lambda worker, block: True), [block("a")])]
    assert [str(answer) for answer in answers] == ["cause"]
    crew = Raising(1)
    crew.stillborn = {0}
    with pytest.raises(ValueError, match="cause"):
        list(fly(crew, [block("a")]))


def test_what_workers_warn_of_is_told_once() -> None:
    crew = MadeCrew(2)
    crew.warned = [("odd", RuntimeWarning)]
    with pytest.warns(RuntimeWarning, match="odd") as told:
        flown(crew, [block("a", number) for number in range(5)])
    assert len(told) == 1


def test_closing_it_lets_everybody_go() -> None:
    crew = MadeCrew(3)
    flying = fly_once(crew, (block("a", number) for number in range(1000)))
    next(flying)
    flying.close()
    assert sorted(crew.dismissed) == [0, 1, 2]


def test_nothing_to_do_hires_nobody() -> None:
    crew = MadeCrew(3)
    assert flown(crew, []) == ([], {}, [])
    assert crew.begun == 0


def test_blocks_are_taken_as_needed_and_forgotten() -> None:
    """However long the plan: 4000 blocks take no more memory than a few."""
    taken = answered = 0

    def plan() -> Iterator[Block]:
        nonlocal taken
        for number in range(4_000):
            taken += 1
            yield block("a", number)

    crew = MadeCrew(4)
    grown = list[int]()
    tracemalloc.start()
    try:
        for _ in fly_once(crew, plan()):
            answered += 1
            assert (
                taken - answered <= (IN_FLIGHT + AHEAD_OF_WORKER) * 4 + AHEAD
            )  # those that are looked at ahead
            if answered in (1_000, 3_000):
                grown.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert answered == 4_000
    assert grown[1] - grown[0] < 200_000  # 2000 blocks, kept, would be 1 MB and more


def test_a_picture_goes_to_few_workers() -> None:
    """Whoever has one goes on with it; at the end they help each other. Blocks of a picture stay in their order."""
    pictures, each, workers = 30, 12, ("x", "y", "z")
    ahead = Lookahead(block(f"{number % pictures}", number // pictures) for number in range(pictures * each))
    rng = np.random.default_rng(0)
    who: dict[str, list[str]] = {}
    order: dict[str, list[int]] = {}
    while (taken := ahead.next_for(worker := workers[rng.integers(3)])) is not None:
        who.setdefault(taken.picture.name, []).append(worker)
        order.setdefault(taken.picture.name, []).append(taken.cells[0].repeat)
    assert order == {f"{picture}": list(range(each)) for picture in range(pictures)}
    shared = [name for name, some in who.items() if len(set(some)) > 1]
    assert len(shared) <= 2  # the last ones


def test_a_worker_that_has_gone_leaves_its_picture_to_another() -> None:
    ahead = Lookahead(block(name, number) for name in "ab" for number in range(3))
    first = [ahead.next_for(worker) for worker in ("x", "y", "x")]
    assert [taken.picture.name for taken in first if taken] == ["a", "b", "a"]
    ahead.forget("y")
    assert [taken.picture.name for taken in map(ahead.next_for, "zz") if taken] == ["b", "b"]
    assert len(ahead.of("a")) == 1
    assert ahead.next_for("x") is None


def test_workers_stay_between_maps_of_the_same_work() -> None:
    class Engine:
        def __init__(self) -> None:
            self.crews: list[MadeCrew] = []

        def crew(self, work: Work) -> MadeCrew:
            self.crews.append(MadeCrew(2))
            return self.crews[-1]

        def map(self, work: Work, blocks: Any) -> Any:
            return fly_once(self.crew(work), blocks)

    engine, camera = Engine(), Camera.preset("imx250")
    with staying(engine) as kept:
        for _ in range(3):
            assert len(list(kept.map(Work((), camera), [block("a"), block("b")]))) == 2
        assert [crew.begun for crew in engine.crews] == [2]
        assert not engine.crews[0].dismissed
        list(kept.map(Work((), camera, "mean"), [block("a")]))
        assert len(engine.crews) == 2
        assert sorted(engine.crews[0].dismissed) == [0, 1]
    assert sorted(engine.crews[1].dismissed) == [0, 1]
