"""Take hold of a scene: path, goal and forces answer, with the numbers that the API and the program give."""

import json
import subprocess
from pathlib import Path

import pytest

from play import EVERY_S, FOLLOWER, LEADER, MOMENT, RECORDING, TIME_S, ask

TRACKS = Path(__file__).parents[2] / "fixtures/ngsim" / f"{RECORDING}.csv.gz"
# What the API rounds places to, m, and a little.
ROUNDED_M = 0.011
SAME = {"abs": ROUNDED_M}


def predicted(url, changes, vehicle=FOLLOWER):
    """The forecast of one vehicle by the API; None where it has none."""
    answer = ask(url, "/v1/predict", {"scene": MOMENT, "changes": changes, "every_s": EVERY_S})
    return next((forecast for forecast in answer["forecasts"] if forecast["id"] == vehicle), None)


def explained(url, changes):
    return ask(url, "/v1/explain", {"scene": MOMENT, "vehicle": FOLLOWER, "changes": changes})


def assert_shows(play, url, changes, vehicle=FOLLOWER):
    """The page has these changes, and draws the path that the API gives for them."""
    assert play.changes() == changes
    path = predicted(url, changes, vehicle)["modes"][0]["path"]
    # The drawn one begins where the vehicle is.
    assert play.forecast(vehicle)[-len(path) :] == [pytest.approx(point, **SAME) for point in path]


def end(path):
    return path[-1][0]


def test_the_scene_is_what_the_tests_need(url):
    as_it_is = predicted(url, [])
    assert as_it_is["leader"] == LEADER and as_it_is["past"] == "full"


def test_a_leader_dragged_back_shortens_the_forecast(page_of, url, picture):
    play = page_of()
    before = play.forecast()
    play.drag(LEADER, [-10, 0])
    (change,) = play.changes()
    assert (change["kind"], change["vehicle"]) == ("move", LEADER)
    assert change["by"] == pytest.approx([-10, 0], abs=0.3)
    assert_shows(play, url, [change])
    shorter = end(before) - end(play.forecast())
    assert shorter > 1, "the follower drives as far as before"
    # What it says is this change: the difference of the explanation is that of the paths.
    change = explained(url, [change])["change"]
    assert change["path"][-1][0] == pytest.approx(-shorter, abs=2 * ROUNDED_M)
    assert play.text("sentence") == change["sentence"]
    picture(play, "dragged")


def test_who_deletes_the_leader_reads_the_counterfactual(page_of, url, program, tmp_path, picture):
    play = page_of()
    before = play.forecast()
    play.press("l", "Delete")
    changes = [{"kind": "remove", "vehicle": LEADER}]
    assert_shows(play, url, changes)
    assert end(play.forecast()) > end(before) + 1
    said = explained(url, changes)
    assert play.text("sentence") == said["change"]["sentence"]
    rows = play.page.locator("#causes tbody tr").all_inner_texts()
    assert any(f"leader {LEADER}" in row for row in rows), rows
    picture(play, "deleted")
    # The same moment by the program, whose numbers are not rounded.
    command = [program, "explain", "--input", TRACKS, "--vehicle", FOLLOWER, "--at", str(TIME_S), "--without", LEADER]
    output = subprocess.run([*command, "--json", "--out", tmp_path], capture_output=True, text=True, check=True).stdout
    other = json.loads(output)
    for side in ["as_it_is", "changed", "change"]:
        assert said[side]["sentence"] == other[side]["sentence"]
        assert said[side]["path"] == [pytest.approx(point, **SAME) for point in other[side]["path"]]
        assert [part["cause"] for part in said[side]["parts"]] == [part["cause"] for part in other[side]["parts"]]
        for ours, theirs in zip(said[side]["parts"], other[side]["parts"], strict=True):
            assert ours["displacement"] == [pytest.approx(point, **SAME) for point in theirs["displacement"]]


def test_undo_and_redo_are_exact(page_of, url):
    play = page_of()
    before = play.forecast()
    play.drag(LEADER, [-10, 0])
    dragged, changes = play.forecast(), play.changes()
    play.press("Delete")
    assert play.changes() == [{"kind": "remove", "vehicle": LEADER}]
    play.press("Control+z")
    assert (play.forecast(), play.changes()) == (dragged, changes), "one undo takes one gesture back"
    play.page.click("#undo")
    play.settle()
    assert (play.forecast(), play.changes()) == (before, [])
    play.press("Control+Shift+z")
    assert (play.forecast(), play.changes()) == (dragged, changes)
    play.page.click("#reset")
    assert (play.settle().forecast(), play.changes()) == (before, [])


def test_a_vehicle_is_added_in_between(page_of, url, picture):
    play = page_of()
    before = play.forecast()
    (x, y), (ahead, _) = play.known[FOLLOWER], play.known[LEADER]
    play.page.click("#add")
    play.page.mouse.click(*play.place((x + ahead) / 2, y))
    (change,) = play.settle().changes()
    assert change["kind"] == "add" and change["at"] == pytest.approx([(x + ahead) / 2, y], abs=2)
    assert_shows(play, url, [change])
    assert predicted(url, [change])["leader"] == change["vehicle"]
    assert end(play.forecast()) < end(before)
    assert play.forecast(change["vehicle"]), "who is added is predicted as well"
    picture(play, "added")
    # It is explained by its causes; there is no path from before.
    play.page.click("#watch")
    play.settle()
    said = ask(url, "/v1/explain", {"scene": MOMENT, "vehicle": change["vehicle"], "changes": [change]})
    assert said["as_it_is"] is None and said["change"] is None
    assert play.text("sentence") == said["changed"]["sentence"]


def test_the_leader_brakes(page_of, url):
    play = page_of()
    before = play.forecast()
    play.press("l", *["-"] * 5)
    (change,) = play.changes()
    assert (change["kind"], change["vehicle"]) == ("speed", LEADER)
    assert_shows(play, url, [change])
    assert end(play.forecast()) < end(before) - 1
    # The wheel on a vehicle in hand does the same.
    play.page.mouse.move(*play.place(*play.known[LEADER]))
    play.page.mouse.wheel(0, -100)
    assert play.settle().changes()[0]["mps"] == pytest.approx(change["mps"] + 1)


def test_a_goal_is_forced(page_of, url):
    play = page_of()
    mode = predicted(url, [])["modes"][0]
    play.drag_from(mode["goal"], [-10, 0])
    (change,) = play.changes()
    assert (change["kind"], change["vehicle"]) == ("goal", FOLLOWER)
    x, y = play.known[FOLLOWER]
    assert [x + change["at"][0], y + change["at"][1]] == pytest.approx([mode["goal"][0] - 10, mode["goal"][1]], abs=0.6)
    assert_shows(play, url, [change])
    assert end(play.forecast()) < end(mode["path"]) - 1


def test_terms_of_the_force_are_switched_off(page_of, url, picture):
    play = page_of()
    terms = [term["name"] for term in ask(url, "/v1/model")["terms"]]
    boxes = play.page.locator("#terms input")
    assert [box.get_attribute("value") for box in boxes.all()] == terms
    boxes.nth(terms.index("goal")).uncheck()
    assert_shows(play.settle(), url, [{"kind": "without_term", "term": "goal"}])
    boxes.nth(terms.index("car_following")).uncheck()
    assert_shows(play.settle(), url, [{"kind": "without_term", "term": term} for term in ["goal", "car_following"]])
    picture(play, "terms")
    boxes.nth(terms.index("goal")).check()
    assert_shows(play.settle(), url, [{"kind": "without_term", "term": "car_following"}])


def test_the_changed_moment_is_driven_on(page_of, url):
    play = page_of()
    play.press("l", "Delete")
    changes = [{"kind": "remove", "vehicle": LEADER}]
    other = next(name for name in play.known if name not in (FOLLOWER, LEADER) and play.forecast(name))

    def apart():
        """Of both on the road, m: the view goes with the watched one."""
        along, _ = play.page.evaluate("window.gnp.perMetre()")
        return (play.where(FOLLOWER)[0] - play.where(other)[0]) / along

    now, ends = apart(), [predicted(url, changes, name)["modes"][0]["path"][-1] for name in (FOLLOWER, other)]
    play.page.locator("#road").focus()
    play.press("End")
    assert play.text("clock") == "+5.0 s" and "held at 8.1 s" in play.text("moment")
    assert apart() == pytest.approx(ends[0][0] - ends[1][0], abs=0.1), "both are where their forecasts end"
    play.press("Home")
    assert apart() == pytest.approx(now, abs=0.1)
    play.press("Escape")
    assert play.changes() == [] and not play.page.locator("#moment").is_visible()
    play.press("Control+z")
    assert_shows(play, url, changes)
