"""The page itself: its link, keyboard, touch, colours, many questions at once, and a server that goes away."""

import re
import time

import pytest

from play import FOLLOWER, LEADER, LINK, PATIENCE_S, TIME_S, ask
from test_whatif import assert_shows

PHONE = {"viewport": {"width": 360, "height": 740}, "has_touch": True, "is_mobile": True, "device_scale_factor": 2}
# Smaller ones are hard to hit, CSS pixels.
TARGET_PX = 40
# Of text and its background (WCAG 2, level AA).
CONTRAST = 4.5
# How late an answer can be: within the patience of the page, and beyond it, where a question gives way to a newer one.
LATE_MS, TOO_LATE_MS = 400, 2500
PATIENCE_MS = 1500
SHADES = """() => {
  const numbers = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const behind = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const [r, g, b, a = 1] = numbers(getComputedStyle(e).backgroundColor);
      if (a === 1) return [r, g, b];
    }
    return [255, 255, 255];
  };
  const light = (colour) => colour.map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const shown = [...document.querySelectorAll("body *")].filter((e) => e.checkVisibility() && !e.disabled && !e.closest(".unseen, dialog"));
  const texts = shown.filter((e) => [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()));
  return texts.map((e) => {
    const pair = [light(numbers(getComputedStyle(e).color).slice(0, 3)), light(behind(e))].sort((a, b) => b - a);
    return [e.id || e.textContent.trim().slice(0, 30), (pair[0] + 0.05) / (pair[1] + 0.05), parseFloat(getComputedStyle(e).fontSize)];
  });
}"""


def test_a_link_holds_scene_and_changes(page_of, url):
    first = page_of()
    first.drag(LEADER, [-10, 0])
    first.press("3")
    assert [change["kind"] for change in first.changes()] == ["move", "without_term"]
    # An address is not written with every movement of a hand.
    first.page.wait_for_url("**/#*move=*&off=*", timeout=PATIENCE_S * 1000)
    link = first.page.evaluate("location.hash")
    second = page_of(link)
    assert (second.changes(), second.forecast()) == (first.changes(), first.forecast())
    assert second.page.evaluate("location.hash") == link
    # What is in a link is a moment, not a history.
    assert second.page.locator("#undo").is_disabled()


@pytest.mark.parametrize(
    "link",
    [
        "#recording=nowhere&road=0&t=8.1",
        f"{LINK}&move=372,ten,0",
        f"{LINK}&remove=999999",
        f"{LINK}&off=magic",
        f"{LINK}&speed=372,1e9",
        f"{LINK}&move=<b>,1,1",
        "#%E0%A4%A",
        "#recording=us101-18_1&road=7&t=-5",
    ],
)
def test_a_link_that_cannot_be_read_is_said_and_a_scene_is_shown(page_of, link):
    play = page_of(link)
    assert play.text("notice"), "nothing is said"
    assert play.changes() == []
    play.press("n")
    assert play.forecast(play.page.locator("#watched").inner_text().removeprefix("Vehicle "))


def test_everything_by_keyboard(page_of, url):
    play = page_of(LINK.removesuffix(f"&watch={FOLLOWER}"))
    names = set()
    for _ in range(len(play.known) + 1):
        play.press("n")
        names.add(play.text("watched"))
        if play.text("watched") == f"Vehicle {FOLLOWER}":
            break
    assert f"Vehicle {FOLLOWER}" in names, "N goes through all vehicles"
    play.press("g", "l", "Shift+ArrowLeft", "ArrowUp")
    assert_shows(play, url, [{"kind": "move", "vehicle": LEADER, "by": [-10, 0.5]}])
    play.press("Control+z", "Control+z", "-")
    assert [change["kind"] for change in play.changes()] == ["speed"]
    play.press("Control+z", "g", "t", "Shift+ArrowRight")
    assert [change["kind"] for change in play.changes()] == ["goal"]
    play.press("r", "a", "Enter")
    assert [change["kind"] for change in play.changes()] == ["add"]
    play.press("r", "1")
    assert [change["kind"] for change in play.changes()] == ["without_term"]
    play.press("r", "?")
    assert play.page.locator("#help-dialog").is_visible()
    play.press("Escape")
    assert not play.page.locator("#help-dialog").is_visible() and play.changes() == []
    # What is said is said to who does not see it, a little later.
    play.press("l", "Delete")
    said = play.text("sentence")
    play.page.locator("#live", has_text=said).wait_for(state="attached", timeout=PATIENCE_S * 1000)


def test_every_control_can_be_reached_and_is_seen_to_be(page_of):
    play = page_of()
    controls = play.page.locator("main button:enabled, main input:enabled, header button, header select, canvas[tabindex]")
    wanted = {control.evaluate("e => e.id || e.value || e.textContent") for control in controls.all() if control.is_visible()}
    reached = set()
    for _ in range(2 * len(wanted)):
        play.page.keyboard.press("Tab")
        name, ring = play.page.evaluate(
            "() => { const e = document.activeElement, s = getComputedStyle(e);"
            " return [e.id || e.value || e.textContent, s.outlineStyle === 'solid' && parseFloat(s.outlineWidth) >= 2]; }"
        )
        assert ring or name not in wanted, f"{name} has the focus and does not show it"
        reached.add(name)
    assert wanted <= reached, f"not reached by Tab: {wanted - reached}"


def touch(play):
    """Fingers on the page: `touch("Start", points)`, `touch("Move", points)`, `touch("End")`."""
    session = play.page.context.new_cdp_session(play.page)

    def send(kind, points=()):
        places = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
        session.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": places})

    return send


def test_a_phone_has_room_and_fingers(page_of, url, picture):
    play = page_of(**PHONE)
    picture(play, "phone", full_page=True)
    wide = play.page.evaluate("document.documentElement.scrollWidth")
    assert wide <= PHONE["viewport"]["width"], f"the page is {wide} px wide"
    small = []
    for control in play.page.locator("button, select, input[type=range], label.term").all():
        box = control.bounding_box()
        if box and min(box["height"], max(box["width"], TARGET_PX)) < TARGET_PX:
            small.append((control.evaluate("e => e.id || e.textContent"), box["width"], box["height"]))
    assert small == []
    finger = touch(play)
    here, there = play.place(*play.known[LEADER]), play.place(play.known[LEADER][0] - 10, play.known[LEADER][1])
    finger("Start", [here])
    for i in range(1, 9):
        finger("Move", [[a + (b - a) * i / 8 for a, b in zip(here, there, strict=True)]])
    finger("End")
    (change,) = play.settle().changes()
    assert (change["kind"], change["vehicle"]) == ("move", LEADER) and change["by"][0] == pytest.approx(-10, abs=1)
    assert_shows(play, url, [change])
    picture(play, "phone-dragged", full_page=True)
    # Two fingers zoom, and change nothing.
    apart = [play.where(vehicle)[0] for vehicle in (FOLLOWER, LEADER)]
    (x, y) = here
    finger("Start", [(x - 20, y), (x + 20, y)])
    for i in range(1, 6):
        finger("Move", [(x - 20 - 8 * i, y), (x + 20 + 8 * i, y)])
    finger("End")
    zoomed = [play.settle().where(vehicle)[0] for vehicle in (FOLLOWER, LEADER)]
    assert abs(zoomed[1] - zoomed[0]) > 1.5 * abs(apart[1] - apart[0])
    assert play.changes() == [change]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_light_and_dark_can_be_read(page_of, picture, scheme):
    play = page_of(color_scheme=scheme)
    play.drag(LEADER, [-10, 0])
    picture(play, scheme)
    shades = play.page.evaluate(SHADES)
    assert len(shades) > 20
    assert [shade for shade in shades if shade[1] < CONTRAST] == []
    assert [shade for shade in shades if shade[2] < 11] == [], "too small to read"
    background = "getComputedStyle(document.body).backgroundColor"
    before = play.page.evaluate(background)
    assert (sum(map(int, re.findall(r"\d+", before)[:3])) < 3 * 128) == (scheme == "dark")
    play.page.click("#theme")
    assert play.page.evaluate(background) != before
    assert play.changes(), "another theme is no other scene"


def late(play, ms):
    """From now on every answer is late: meanwhile the hand is elsewhere."""
    line = {"offline": False, "latency": ms, "downloadThroughput": -1, "uploadThroughput": -1}
    play.page.context.new_cdp_session(play.page).send("Network.emulateNetworkConditions", line)


def test_of_a_fast_drag_the_newest_answer_is_drawn(page_of, url):
    play = page_of()
    asked = len(play.bodies)
    late(play, LATE_MS)
    begin = time.monotonic()
    play.drag(LEADER, [-12, 0], steps=30, drop=False)
    play.page.mouse.move(*play.place(play.known[LEADER][0] + 3, play.known[LEADER][1]), steps=30)
    play.page.mouse.up()
    (change,) = play.settle().changes()
    took_ms = 1000 * (time.monotonic() - begin)
    assert change["by"][0] == pytest.approx(3, abs=0.3)
    assert_shows(play, url, [change])
    bodies = play.bodies[asked:]
    assert bodies[-1][1]["changes"] == [change]
    # One question under way, of two requests.
    assert len(bodies) <= 2 * (took_ms / LATE_MS + 1), f"{len(bodies)} requests in {took_ms:.0f} ms"


def test_a_question_without_an_answer_gives_way_to_the_newest(page_of, url):
    play = page_of()
    dropped = []
    play.page.on("requestfailed", lambda request: dropped.append((request.post_data_json or {}).get("changes")))
    late(play, TOO_LATE_MS)
    play.drag(LEADER, [-4, 0], drop=False)
    play.page.wait_for_timeout(PATIENCE_MS + 200)
    assert dropped == []
    play.page.mouse.move(*play.place(play.known[LEADER][0] - 10, play.known[LEADER][1]))
    play.page.mouse.up()
    (change,) = play.settle().changes()
    assert dropped and [change] not in dropped
    assert_shows(play, url, [change])


def test_a_server_that_goes_is_missed_and_found_again(page_of, server_of, picture):
    server = server_of()
    play = page_of(server=server.url, allowed="ERR_CONNECTION_REFUSED|ERR_EMPTY_RESPONSE|ERR_CONNECTION_RESET")
    before = play.forecast()
    assert server.stop() == 0
    play.page.keyboard.press("l")
    play.page.keyboard.press("Delete")
    notice = play.page.locator("#notice")
    notice.filter(has_text="does not answer").wait_for(timeout=PATIENCE_S * 1000)
    picture(play, "alone")
    server_of(int(server.url.rsplit(":", 1)[1]))
    play.page.wait_for_selector("#notice:not(:has-text('does not answer'))", state="attached", timeout=PATIENCE_S * 1000)
    play.settle()
    assert play.changes() == [{"kind": "remove", "vehicle": LEADER}]
    assert play.forecast()[-1][0] > before[-1][0] + 1


def test_a_problem_is_said_in_words(page_of):
    play = page_of(allowed="status of 422")
    problem = {"type": "urn:gnp:problem:made-up", "title": "Made up", "status": 422, "detail": "the moon is in the way"}
    answer = {"status": 422, "content_type": "application/problem+json", "json": problem}
    play.page.route("**/v1/predict", lambda route: route.fulfill(**answer))
    play.page.keyboard.press("l")
    play.page.keyboard.press("Delete")
    play.page.locator("#notice", has_text="the moon is in the way").wait_for(timeout=PATIENCE_S * 1000)


def test_the_recording_plays_with_live_forecasts(page_of, url):
    begin_s = TIME_S - 4
    play = page_of(LINK.replace(f"t={TIME_S}", f"t={begin_s:.1f}"))
    play.page.click("#play")
    play.page.wait_for_timeout(1500)
    play.page.click("#play")
    play.settle()
    time_s = float(play.text("clock").removesuffix(" s"))
    assert begin_s + 0.7 < time_s < begin_s + 3
    bodies = [body for path, body in play.bodies if path == "/v1/predict"]
    assert bodies[-1]["scene"]["time_s"] == pytest.approx(time_s, abs=0.11)
    answer = ask(url, "/v1/predict", bodies[-1])
    path = next(forecast for forecast in answer["forecasts"] if forecast["id"] == FOLLOWER)["modes"][0]["path"]
    assert play.forecast()[-1] == pytest.approx(path[-1], abs=0.011)
    assert play.changes() == []


def test_what_the_policy_forbids_does_not_happen(page_of):
    play = page_of(allowed="Content Security Policy")
    script = "const s = document.createElement('script'); s.textContent = 'window.inline = 1'; document.head.append(s);"
    assert play.page.evaluate(f"() => {{ {script} return window.inline ?? 0; }}") == 0
    elsewhere = "fetch('http://localhost:9/').then(() => 'asked', () => 'refused')"
    assert play.page.evaluate(elsewhere) == "refused"
    style = "() => { document.body.insertAdjacentHTML('beforeend', '<p id=\"styled\" style=\"color: red\">x</p>'); return getComputedStyle(document.getElementById('styled')).color; }"
    assert play.page.evaluate(style) != "rgb(255, 0, 0)"
    # Each is reported, so that other tests see whatever of it the page does by itself.
    assert len(play.troubles) >= 3
