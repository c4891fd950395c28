"""What happens within a drag, speeds, the history of scenes, and what is said of all that."""

import json
import math
import re

import pytest

from play import FOLLOWER, LEADER, LINK, MOMENT, PATIENCE_S, RECORDING, TIME_S, ask
from test_page import PHONE, touch

SECOND = "us101-10_1"


def test_keys_do_not_disturb_a_drag(page_of):
    play = page_of()
    play.drag(LEADER, [-5, 0], drop=False)
    dragged = play.changes()
    for key in ["Delete", "Control+z", "r"]:
        play.page.keyboard.press(key)
        assert play.changes() == dragged, f"{key} acts within a drag"
    play.page.mouse.move(*play.place(play.known[LEADER][0] - 10, play.known[LEADER][1]))
    play.page.mouse.up()
    (change,) = play.settle().changes()
    assert change["kind"] == "move" and change["by"][0] == pytest.approx(-10, abs=0.3)
    play.press("Control+z")
    assert play.changes() == []


def test_an_added_vehicle_that_goes_is_let_go(page_of):
    play = page_of()
    play.press("a", "Enter")
    (added,) = play.changes()
    play.drag_from(added["at"], [3, 0], drop=False)
    # As a second finger can, on a button.
    play.page.evaluate("document.getElementById('remove').click()")
    play.page.mouse.move(*play.place(added["at"][0] - 8, added["at"][1]), steps=4)
    play.page.mouse.up()
    assert play.settle().changes() == []
    assert "dragging" not in (play.page.locator("#road").get_attribute("class") or "")


def test_escape_takes_a_drag_back_and_keeps_what_can_be_redone(page_of):
    play = page_of()
    play.press("l", "Delete", "Control+z")
    play.drag(LEADER, [-10, 0], drop=False)
    play.page.keyboard.press("Escape")
    play.page.mouse.move(*play.place(*play.known[FOLLOWER]), steps=3)
    play.page.mouse.up()
    assert play.settle().changes() == []
    play.press("Control+Shift+z")
    assert play.changes() == [{"kind": "remove", "vehicle": LEADER}]


def test_a_second_finger_ends_a_drag(page_of):
    play = page_of(**PHONE)
    finger, (x, y) = touch(play), play.place(*play.known[LEADER])
    finger("Start", [(x, y)])
    finger("Move", [(x - 20, y)])
    finger("Move", [(x - 40, y)])
    assert "dragging" in play.page.locator("#road").get_attribute("class")
    finger("Start", [(x - 40, y), (x + 40, y)])
    finger("End")
    assert play.settle().changes() == []
    assert "dragging" not in play.page.locator("#road").get_attribute("class")


def test_back_returns_to_the_scene_that_was_left(page_of):
    play = page_of()
    play.press("l", "Delete")
    changes, path = play.changes(), play.forecast()
    play.page.select_option("#recording", SECOND)
    play.page.wait_for_url(f"**/#recording={SECOND}*", timeout=PATIENCE_S * 1000)
    assert play.settle().changes() == []
    play.page.go_back()
    play.page.wait_for_selector("#changes li", timeout=PATIENCE_S * 1000)
    assert (play.settle().changes(), play.forecast()) == (changes, path)


LINKS = """async ([state, view]) => {
  const { read, write } = await import("/page/link.js");
  return read(write(state, view));
}"""


def test_every_address_that_is_written_can_be_read(page_of):
    changes = [{"kind": "move", "vehicle": f"a, b&{i}", "by": [-i, 0.25]} for i in range(496)]
    changes += [
        {"kind": "add", "vehicle": "new 1", "at": [512345.25, -1.5], "mps": 20.13, "class": "car", "size": [4.5, 1.8]},
        {"kind": "speed", "vehicle": "7", "mps": 0},
        {"kind": "goal", "vehicle": "7", "at": [90, -3.5]},
        {"kind": "without_term", "term": "goal"},
    ]
    view = {"centre": 5123456789, "span": 120}
    state = {"recording": "tracks, " + "x" * 240, "road": 3, "time": 1724932800.125, "watched": "7", "held": True, "changes": changes}
    found = page_of().page.evaluate(LINKS, [state, view])
    assert found == state | {"view": view}


def test_the_speed_is_the_one_that_is_predicted_from(page_of, url):
    play = page_of()
    speeds = {f["id"]: math.hypot(*f["velocity"]) for f in ask(url, "/v1/predict", {"scene": MOMENT})["forecasts"]}
    assert f"{speeds[FOLLOWER]:.1f} m/s" in play.text("facts")
    play.press("l")
    assert play.text("speed-value") == f"{speeds[LEADER]:.1f} m/s"
    play.press("+", "+")
    (change,) = play.changes()
    assert change["mps"] == pytest.approx(speeds[LEADER] + 2, abs=0.11)
    play.press("-", "-")
    assert play.changes() == [], "as fast as before is no change"


def test_the_focus_stays_with_the_changes(page_of):
    play = page_of()
    play.press("l", "Delete", "1", "2")
    focused = "document.activeElement.id || document.activeElement.getAttribute('aria-label')"
    play.page.locator("#changes button").nth(1).focus()
    play.press("Enter")
    assert play.page.evaluate(focused).startswith("Take back") and len(play.changes()) == 2
    # Faster than the list is drawn anew: the second one has nothing to take back.
    play.page.evaluate("() => { const last = document.activeElement; last.click(); last.click(); }")
    assert len(play.settle().changes()) == 1
    play.press("Enter")
    assert (play.changes(), play.page.evaluate(focused)) == ([], "undo")


def test_hands_and_changes_are_read_aloud(page_of):
    play = page_of()
    hears = lambda text: play.page.locator("#live", has_text=text).wait_for(state="attached", timeout=PATIENCE_S * 1000)
    play.press("l")
    hears(f"In hand: vehicle {LEADER}.")
    play.press("Delete")
    hears(f"vehicle {LEADER} removed.")
    play.press("Control+z")
    hears(f"No longer: vehicle {LEADER} removed.")


def served(play, change):
    """Lets `change` make other recordings of those that the server lists."""

    def answer(route):
        recordings = route.fetch().json()["recordings"]
        route.fulfill(json={"recordings": change(recordings)})

    play.page.route("**/v1/recordings", answer)


def test_other_recordings_of_a_server_that_was_away(page_of):
    play = page_of(allowed="status of 404")
    served(play, lambda recordings: [r for r in recordings if r["name"] != RECORDING])
    problem = {"type": "urn:gnp:problem:unknown-recording", "title": "Unknown recording", "status": 404, "detail": "there is no such recording"}
    of_it = lambda route: RECORDING in (route.request.post_data or "")
    refuse = lambda route: route.fulfill(status=404, content_type="application/problem+json", json=problem) if of_it(route) else route.continue_()
    play.page.route("**/v1/predict", refuse)
    play.page.keyboard.press("l")
    play.page.keyboard.press("Delete")
    play.page.locator("#notice", has_text=f"{RECORDING} is not served any more").wait_for(timeout=PATIENCE_S * 1000)
    assert RECORDING not in play.page.locator("#recording option").all_inner_texts()
    play.settle()
    assert play.changes() == [] and play.forecast(play.text("watched").removeprefix("Vehicle "))


SINCE_1970_S = 1_700_000_000


def test_times_since_1970_are_shown_since_the_start_and_linked_whole(page_of):
    play = page_of()
    path, begin = play.forecast(), []

    def later(recordings):
        for recording in recordings:
            begin.append(recording["from_s"]) if recording["name"] == RECORDING else None
            for end in ["from_s", "to_s"]:
                recording[end] += SINCE_1970_S
        return recordings

    def tracks(route):
        numbers = lambda found: f"{found[1]}={float(found[2]) - SINCE_1970_S:.3f}"
        answer = route.fetch(url=re.sub(r"(from_s|to_s)=([\d.]+)", numbers, route.request.url)).json()
        route.fulfill(json={**answer, "from_s": answer["from_s"] + SINCE_1970_S})

    def question(route):
        body = route.request.post_data_json
        body["scene"]["time_s"] = round(body["scene"]["time_s"] - SINCE_1970_S, 4)
        route.continue_(post_data=json.dumps(body))

    served(play, later)
    play.page.route("**/tracks?*", tracks)
    play.page.route(re.compile("/v1/(predict|explain)$"), question)
    play.page.goto("about:blank")
    play.open(LINK.replace(f"t={TIME_S}", f"t={SINCE_1970_S + TIME_S}"))
    assert play.forecast() == path
    assert play.text("clock") == f"{TIME_S - begin[0]:.1f} s"
    play.press("l", "Delete")
    play.page.wait_for_url("**/#*remove=*", timeout=PATIENCE_S * 1000)
    play.page.reload()
    play.page.wait_for_selector("html[data-ready='1']", state="attached", timeout=PATIENCE_S * 1000)
    assert play.settle().changes() == [{"kind": "remove", "vehicle": LEADER}]


def test_what_is_simulated_is_said_and_carriageways_can_be_chosen(page_of, url):
    def made_up(recordings):
        for recording in recordings:
            recording["simulated"] = True
            recording["roads"] = [recording["roads"][0], {**recording["roads"][0], "index": 1}]
        return recordings

    play = page_of("#")
    assert not play.page.locator("#simulated").is_visible() and not play.page.locator("#carriageway").is_visible()
    served(play, made_up)
    play.page.reload()
    play.page.wait_for_selector("html[data-ready='1']", state="attached", timeout=PATIENCE_S * 1000)
    assert play.text("simulated") == "simulated"
    assert play.page.locator("#carriageway option").all_inner_texts() == ["0", "1"]


def test_a_change_of_a_link_that_the_server_refuses_is_marked(page_of):
    play = page_of(allowed="status of 422")
    play.page.goto(f"{play.url}/{LINK}&speed={LEADER},1000")
    play.page.locator("#changes li.wrong").wait_for(timeout=PATIENCE_S * 1000)
    assert play.text("notice")
    play.page.click("#changes button")
    play.page.wait_for_selector("#notice:empty", state="attached", timeout=PATIENCE_S * 1000)
    assert play.settle().forecast()


def test_of_a_crowd_as_many_are_asked_for_as_the_server_takes(page_of):
    play = page_of()
    few = 5

    def card(route):
        route.fulfill(json={**route.fetch().json(), "max_vehicles": few})

    play.page.route("**/v1/model", card)
    play.page.reload()
    play.page.wait_for_selector("html[data-ready='1']", state="attached", timeout=PATIENCE_S * 1000)
    asked = [body for path, body in play.settle().bodies if path == "/v1/predict"][-1]["vehicles"]
    assert len(asked) == few and FOLLOWER in asked


def test_a_term_has_one_name(page_of, url):
    labels = {term["name"]: term["label"] for term in ask(url, "/v1/model")["terms"]}
    causes = ask(url, "/v1/explain", {"scene": MOMENT, "vehicle": FOLLOWER})["as_it_is"]["parts"]
    rows = page_of().page.locator("#causes th[scope=row]").all_inner_texts()
    assert "free road and habit" in rows and "free road" not in rows
    of_terms = [cause["cause"] for cause in causes if cause["kind"] == "term"]
    assert not set(rows) & {name for name in of_terms if labels[name] != name}
