"""What a visitor of the page sees and does."""

from __future__ import annotations

import http.client
import tomllib
from urllib.parse import urlparse

import numpy as np
import pytest

from simulator import load_scenario, simulate, simulate_many
from simulator.results.plot.map import BEHAVIOURS

SCENARIO = "scenarios/fig5b_state_b.toml"


def drawn(visit, name="v0"):
    return np.array(visit.column("samples", name), dtype=float)


def shown_at(visit):
    """The opacity of the pictures."""
    return visit.page.evaluate(
        "Number(getComputedStyle(Bokeh.index.find_one("
        "Bokeh.documents[0].get_model_by_name('loop')).el).opacity)"
    )


def test_the_page_draws_the_history(visit):
    page = visit()
    history = simulate(SCENARIO)
    x, y = drawn(page), drawn(page, "s0")
    assert np.array_equal(x[np.isfinite(x)], history.voltage[:, 0])
    assert np.array_equal(y[np.isfinite(y)], history.stretch[:, 0])
    assert np.isnan(x).sum() == 3  # a line is broken where the balloons jump
    assert page.page.get_by_text("2 × limit point, 1 × voltage jump").is_visible()


def test_it_is_drawn_anew_before_the_slider_is_let_go_of(visit):
    page = visit()
    slider = page.slider("ramp")
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    mouse = page.page.mouse
    mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    mouse.down()
    mouse.move(box["x"] + box["width"] * 0.75, box["y"] + box["height"] / 2, steps=4)
    page.until(lambda: np.nanmax(drawn(page)) > 0.25)
    assert np.nanmax(page.column("ghost", "v0")) == 0.2  # what was shown before, faintly
    high = page.page.evaluate("Bokeh.documents[0].get_model_by_name('loop').x_range.end")
    mouse.move(box["x"] + box["width"] * 0.3, box["y"] + box["height"] / 2, steps=4)
    page.until(lambda: np.nanmax(drawn(page)) < 0.15)
    during = page.page.evaluate("Bokeh.documents[0].get_model_by_name('loop').x_range.end")
    assert during >= high  # axes only grow meanwhile
    mouse.up()
    page.until(
        lambda: page.page.evaluate("Bokeh.documents[0].get_model_by_name('voltage').y_range.end") < 0.15
    )


def test_a_slider_stays_in_the_hand_while_words_change_and_a_value_is_wrong(visit):
    page = visit()
    for name, low, high in (("ramp", 0.3, 0.7), ("radius", 0.0, 0.8)):
        slider = page.slider(name)
        slider.scroll_into_view_if_needed()
        box = slider.bounding_box()
        to = [box["x"] + share * box["width"] for share in (0.5, low, high)]
        page.page.mouse.move(to[0], box["y"] + box["height"] / 2)
        page.page.mouse.down()
        held = float(page.field(name).input_value())
        page.page.mouse.move(to[1], box["y"] + box["height"] / 2)
        if name == "ramp":  # below the limit point: other words
            page.page.get_by_text("1 × limit point, 1 × voltage jump").wait_for()
        else:
            page.page.get_by_text("must be a number > 0", exact=True).wait_for()
            assert shown_at(page) == 0.4  # dimmed
        page.page.wait_for_timeout(200)
        page.page.mouse.move(to[2], box["y"] + box["height"] / 2)
        page.until(lambda held=held, name=name: float(page.field(name).input_value()) not in (0.0, held))
        assert float(page.field(name).input_value()) > 0.1
        page.until(lambda: shown_at(page) == 1)
        page.page.mouse.up()


def test_an_exact_field_takes_what_the_scenario_takes(visit):
    page = visit()
    page.field("ramp").fill("0.1")
    page.field("ramp").press("Enter")
    page.page.get_by_text("1 × limit point, 1 × voltage jump").wait_for()
    assert np.nanmax(drawn(page)) == 0.1


def test_a_wrong_value_is_told_below_its_own_field_and_the_last_picture_stays(visit):
    page = visit()
    before = drawn(page)
    page.field("radius").fill("-1")
    page.field("radius").press("Enter")
    alert = page.page.get_by_text("must be a number > 0", exact=True)
    alert.wait_for()
    field, said = page.field("radius").bounding_box(), alert.bounding_box()
    assert 0 <= said["y"] - (field["y"] + field["height"]) < 20
    assert page.field("radius").get_attribute("aria-invalid") == "true"
    assert np.array_equal(drawn(page), before, equal_nan=True)
    page.field("radius").fill("0.5")
    page.field("radius").press("Enter")
    alert.wait_for(state="hidden")


def test_a_link_holds_what_was_changed_and_leads_back_to_it(visit):
    page = visit()
    page.field("ambient pressure").fill("0.05")
    page.field("ambient pressure").press("Enter")
    page.until(lambda: "gas.ambient_pressure=0.05" in page.page.url)
    again = visit("?" + page.page.url.partition("?")[2])
    assert again.field("ambient pressure").input_value() == "0.05"
    assert np.array_equal(drawn(again), drawn(page), equal_nan=True)
    assert page.page.url.partition("?")[2] == "gas.ambient_pressure=0.05"


def test_a_link_with_an_unknown_key_is_not_followed(visit):
    page = visit("?gas.colour=3")
    assert page.page.get_by_text("gas.colour").is_visible()
    assert page.field("ambient pressure").input_value() == "1"


def test_everything_moves_by_keyboard(visit):
    page = visit()
    page.slider("ambient pressure").focus()
    page.page.keyboard.press("ArrowLeft")
    page.until(lambda: page.field("ambient pressure").input_value() == "0.99")
    page.page.get_by_label("moment shown").focus()
    page.page.keyboard.press("Home")
    page.until(lambda: page.column("now", "y") == [1.0])


def test_an_event_is_gone_to_and_playback_moves_on(visit):
    page = visit()
    page.page.get_by_label("Events").select_option(index=2)
    page.until(lambda: abs(page.column("now", "x")[0] - 0.13925397) < 1e-6)
    page.page.get_by_text("▶ Play").click()
    page.until(lambda: page.column("now", "y")[0] > 6.2)
    page.page.get_by_text("❚❚ Pause").click()


WITHOUT_THE_JUMP = "completed at time 21; 2 × limit point"


def test_steps_are_added_and_removed(visit):
    page = visit()
    page.page.get_by_text("Remove step 4").click()
    page.page.get_by_text("Remove step 5").wait_for(state="detached")
    page.until(lambda: page.page.get_by_role("status").all_text_contents() == [WITHOUT_THE_JUMP])
    page.page.get_by_text("Add step").click()
    page.page.get_by_text("Remove step 5").wait_for()
    page.until(lambda: np.nanmax(drawn(page, "t")) == 26.0)


def test_a_step_becomes_one_of_another_kind(visit):
    page = visit()
    page.page.get_by_label("Kind of step 2").select_option("jump")
    page.page.get_by_role("heading", name="Step 2: jump").wait_for()
    page.until(lambda: np.nanmax(drawn(page, "t")) == 11.0)
    assert page.field("jump").input_value() == "0.2"


def test_a_corner_of_the_voltage_is_dragged(visit):
    page = visit()
    place = """() => {
      const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name("voltage"))
      const { x_scale, y_scale, bbox } = view.frame, box = view.el.getBoundingClientRect()
      return [box.x + x_scale.compute(11), box.y + y_scale.compute(0.2), bbox.height, bbox.width]
    }"""
    x, y, height, width = page.page.evaluate(place)
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x - 0.2 * width, y + 0.3 * height, steps=6)
    page.until(lambda: 0.1 < np.nanmax(drawn(page)) < 0.17)
    page.page.mouse.up()
    page.until(lambda: "step.2.over" in page.page.url)
    ramp = float(page.field("ramp").input_value())
    over = float(page.page.get_by_label("over", exact=True).nth(1).input_value())
    assert 0.12 < ramp < 0.16
    assert 5 < over < 7
    assert np.nanmax(drawn(page)) == ramp
    assert page.column("corners", "x")[0] == pytest.approx(1 + over)


def test_a_failed_run_shows_how_far_it_came_and_says_so(failing):
    page = failing
    failed = page.page.get_by_text("The solver failed: step 3, time 11: <b>no point</b> was found")
    page.field("ambient pressure").fill("0.9")
    page.field("ambient pressure").press("Enter")
    failed.wait_for()
    assert failed.get_attribute("role") == "alert"
    page.until(lambda: np.nanmax(drawn(page, "t")) == 11.0)
    assert shown_at(page) == 1  # it is a result, as far as it goes
    page.field("ambient pressure").fill("1")
    page.field("ambient pressure").press("Enter")
    failed.wait_for(state="hidden")
    page.until(lambda: np.nanmax(drawn(page, "t")) == 21.0)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("fig2_inflation", "2 × limit point"),  # no voltage at all
        ("charge_control", "completed at time"),
        ("delayed_snap", "completed at time"),  # in real time
        ("ring", "completed at time"),
    ],
)
def test_other_scenarios_are_started_from(visit, name, words):
    page = visit()
    page.page.get_by_label("Start from").select_option(name)
    page.until(lambda: f"scenario={name}" in page.page.url)
    history = simulate(f"scenarios/{name}.toml")
    page.until(lambda: np.nanmax(drawn(page, "t")) == history.time[-1])
    assert words in page.page.get_by_role("status").first.inner_text()
    pressure = drawn(page, "p")
    assert np.array_equal(pressure[np.isfinite(pressure)], history.pressure)
    again = visit("?" + page.page.url.partition("?")[2])
    assert np.array_equal(drawn(again, "p"), pressure, equal_nan=True)


def test_units_are_those_of_the_scenario_on_axes_in_fields_and_on_the_map(visit):
    page = visit("?scenario=vhb_snap")
    label = "Bokeh.documents[0].get_model_by_name(%r).%s[0].axis_label"
    assert page.field("ramp").input_value() == "5.5 kV"
    assert page.page.evaluate(label % ("loop", "below")) == "voltage [kV]"
    assert page.page.evaluate(label % ("pressure", "left")) == "[kPa]"
    assert np.nanmax(drawn(page)) == pytest.approx(5.5)
    page.page.get_by_text("Phase map").click()
    page.page.get_by_label("across").select_option("step.2.ramp")
    page.page.get_by_label("upwards").select_option("step.1.inflate")
    page.until(lambda: page.page.evaluate(label % ("map", "below")) == "step.2.ramp [kV]")
    columns = [page.column("cells", name) for name in ("x", "y", "colour")]
    place = min(range(1600), key=lambda i: abs(columns[0][i] - 3.0) + abs(columns[1][i] - 1.0))
    x, y, colour = (column[place] for column in columns)
    one = load_scenario("scenarios/vhb_snap.toml").with_values(
        {"step.2.ramp": f"{x} kV", "step.1.inflate": f"{y} kPa"}
    )
    behaviour = simulate_many(one, {"solver.rtol": one.solver.rtol})["behaviour"][0]
    assert colour == BEHAVIOURS[behaviour][0]
    picture = page.page.locator(".bk-Figure").last
    picture.scroll_into_view_if_needed()
    box = picture.bounding_box()
    page.page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.4 * box["height"])
    page.until(lambda: "step.2.ramp=" in page.page.url)
    assert page.field("ramp").input_value().endswith(" kV")
    assert page.field("inflate").input_value().endswith(" kPa")


def test_downloads(visit, tmp_path):
    page = visit()
    for label, suffix in (("TOML", ".toml"), ("CSV", ".csv"), ("PNG", ".png")):
        with page.page.expect_download() as found:
            page.page.get_by_text(label, exact=True).click()
        found.value.save_as(tmp_path / f"got{suffix}")
    written = tomllib.loads((tmp_path / "got.toml").read_text("utf-8"))
    assert load_scenario(written) == load_scenario(SCENARIO)
    history = simulate(SCENARIO)
    lines = (tmp_path / "got.csv").read_text("utf-8").splitlines()
    assert lines[0].split(",") == list(history.to_dataframe().columns)
    assert len(lines) == len(history) + 1
    assert (tmp_path / "got.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("query", ["", "?theme=dark"])
def test_axe_finds_nothing(visit, query):
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(visit(query).page).response["violations"]
    assert [(rule["id"], len(rule["nodes"])) for rule in found] == []


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"Host": "evil.example"}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Host": "127.0.0.1:1"}, 403),
    ],
)
def test_other_hosts_and_pages_are_refused(address, headers, status):
    place = urlparse(address)
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=30)
    connection.request("GET", "/", headers=headers)
    assert connection.getresponse().status == status
    connection.close()


def test_the_map_is_computed_and_a_click_goes_there(visit):
    page = visit()
    page.page.get_by_text("Phase map").click()
    page.until(lambda: len(page.column("cells", "x")) == 1600)
    picture = page.page.locator(".bk-Figure").last
    picture.scroll_into_view_if_needed()
    box = picture.bounding_box()
    page.page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 0.4 * box["height"])
    page.until(lambda: "gas.ambient_pressure" in page.page.url and "step.1.inflate" in page.page.url)
    assert 1.2 < float(page.field("ambient pressure").input_value()) < 1.7
    assert 2.4 < float(page.field("inflate").input_value()) < 3.5
    page.until(lambda: page.column("here", "x")[0] == float(page.field("ambient pressure").input_value()))


def test_axe_finds_nothing_with_a_wrong_value_and_the_map_and_the_text_open(visit):
    from axe_playwright_python.sync_playwright import Axe

    page = visit()
    page.page.get_by_role("heading", name="Text", exact=True).click()
    page.page.get_by_text("Phase map").click()
    page.until(lambda: len(page.column("cells", "x")) == 1600)
    page.field("radius").fill("-1")
    page.field("radius").press("Enter")
    page.page.get_by_text("must be a number > 0", exact=True).wait_for()
    found = Axe().run(page.page).response["violations"]
    assert [(rule["id"], len(rule["nodes"])) for rule in found] == []
