/*
 * Replay of simulated runs: one component, no framework, no network.
 *
 *   const replay = rvsgReplay.mount(element, data, { map: svg, address: true, keys: document });
 *   ...
 *   replay.destroy();
 *
 * `element` receives the controls. `data` is the JSON that rvsg/report/payload.py makes. `map` is an <svg> with the
 * floor plan in it; the component draws over it. Without it, `data.floor` is the plan as SVG text, made by
 * rvsg.report.page.floor_svg. `stage` receives the map, its timeline and its controls instead of `element`, and begins
 * with the map cropped to the encounter; `run` and `t` say what is shown first. With `address` the shown run and time are kept in location.hash as
 * #run=ID&t=SECONDS, and #runs=ID,ID marks several runs. `keys` is where keyboard shortcuts are listened for (default:
 * the element). The component needs the styles of rvsg.report.page.styles() and no global but `rvsgReplay`; a page
 * can hold several.
 *
 * A layer is drawn on the map between the floor plan and the bodies, and has a switch where a run has it:
 *
 *   replay.addLayer({
 *     id: "lidar", label: "Lidar", shown: true,
 *     has: function (run) { return true; },            // run: its id
 *     draw: function (group, view) { ... },            // group: an SVG <g>; called at every change of run or time
 *     say: function (view) { return "Phase: spin."; }  // optional: a sentence beside the time
 *   });
 *
 * `view` is { run, t, scale, point(x, y), matrix(x, y), node(parent, tag, attributes) }: the run's id, the time in s,
 * pixels per unit of the plan, a world point (m) on the plan, and the transform that puts a drawing in metres, x to the
 * east and y to the north, at a world point.
 *
 * A run's blob is base64 of a zlib stream of channels. A channel is a list of integers: the first value, then
 * differences, as zigzag varints. Channels: x, y (cm), yaw (0.01 rad), v (cm/s), gap to the nearest person (mm), then
 * x, y (cm), yaw (0.05 rad) of each person of the run. `near` lists [sample, person] where the nearest person changes. Samples are `period` seconds apart; people listed in `far` have
 * every fifth sample.
 *
 * Text from the data is only ever set with textContent.
 */
(function (root) {
  "use strict";
  const SVG = "http://www.w3.org/2000/svg";
  const MANY = 4, FRAMES = 7, FAR_STEP = 5, PART_M = 0.25, SHORT_M = 0.03, SMALLEST_PX = 11.5, LARGEST_PX = 17;
  const SPEEDS = [0.25, 0.5, 1, 2, 5, 10];
  const LANES = [["gap", "gap"], ["contact", "contact"], ["standing", "standing"], ["recovery", "recovery"], ["violated", "violated"]];

  function html(parent, tag, attributes, text) {
    const node = document.createElement(tag);
    for (const key in attributes) node.setAttribute(key, attributes[key]);
    if (text !== undefined) node.textContent = text;
    if (parent) parent.appendChild(node);
    return node;
  }
  function svg(parent, tag, attributes, text) {
    const node = document.createElementNS(SVG, tag);
    for (const key in attributes) node.setAttribute(key, attributes[key]);
    if (text !== undefined) node.textContent = text;
    if (parent) parent.appendChild(node);
    return node;
  }
  function number(value, unit) {
    if (value === null || value === undefined) return "no value";
    const size = Math.abs(value);
    const text = size >= 1000 ? value.toFixed(0) : String(+value.toPrecision(3));
    return unit ? text + "\u00a0" + unit : text;
  }
  /** Whether a box (left, top, right, bottom) covers none of others. */
  function apart(box, others) {
    return others.every(function (o) { return box[2] <= o[0] || o[2] <= box[0] || box[3] <= o[1] || o[3] <= box[1]; });
  }
  function clamp(value, low, high) { return Math.min(high, Math.max(low, value)); }

  /* ---- data ---- */

  function channels(bytes) {
    let at = 0;
    return function (count, scale) {
      const out = new Float64Array(count);
      let last = 0;
      for (let k = 0; k < count; k++) {
        let value = 0, factor = 1, byte;
        do { byte = bytes[at++]; value += (byte & 127) * factor; factor *= 128; } while (byte & 128);
        last += value % 2 ? -(value + 1) / 2 : value / 2;
        out[k] = last * scale;
      }
      return out;
    };
  }
  function filled(values, step, count) {
    const out = new Float64Array(count);
    for (let k = 0; k < count; k++) {
      const low = Math.min(Math.floor(k / step), values.length - 1), high = Math.min(low + 1, values.length - 1);
      out[k] = values[low] + (values[high] - values[low]) * (k / step - low > 1 ? 1 : k / step - low);
    }
    return out;
  }
  async function decode(run, group, period) {
    const packed = Uint8Array.from(atob(run.blob), function (c) { return c.charCodeAt(0); });
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const next = channels(new Uint8Array(await new Response(stream).arrayBuffer()));
    const n = run.samples;
    const series = { n: n, near: run.near || [], t0: run.t0, period: period, end: run.t0 + Math.max(0, n - 1) * period };
    series.x = next(n, 0.01); series.y = next(n, 0.01); series.yaw = next(n, 0.01);
    series.v = next(n, 0.01); series.gap = next(n, 0.001);
    series.people = group.people.map(function () { return null; });
    run.present.forEach(function (place, h) {
      const step = run.far.includes(h) ? FAR_STEP : 1, count = Math.ceil(n / step);
      const x = next(count, 0.01), y = next(count, 0.01), yaw = next(count, 0.05);
      series.people[place] = step === 1 ? { x: x, y: y, yaw: yaw } : { x: filled(x, step, n), y: filled(y, step, n), yaw: filled(yaw, step, n) };
    });
    return series;
  }
  function at(values, series, t) {
    const place = clamp((t - series.t0) / series.period, 0, series.n - 1), low = Math.floor(place);
    const high = Math.min(low + 1, series.n - 1);
    return values[low] + (values[high] - values[low]) * (place - low);
  }
  function curveAt(curve, t) {
    let found = null;
    for (let k = 0; k < curve.t.length && curve.t[k] <= t + 1e-6; k++) if (curve.value[k] !== null) found = curve.value[k];
    return found;
  }
  /** When two runs part: the first time at which the robot or a person of one is 25 cm from where it is in the other. */
  function parting(a, b, people) {
    const n = Math.min(a.n, b.n);
    for (let k = 0; k < n; k++) {
      if (Math.hypot(a.x[k] - b.x[k], a.y[k] - b.y[k]) > PART_M) return { t: a.t0 + k * a.period, who: "the robot" };
      for (let h = 0; h < people.length; h++) {
        const p = a.people[h], q = b.people[h];
        if (p && q && people[h].colour && Math.hypot(p.x[k] - q.x[k], p.y[k] - q.y[k]) > PART_M)
          return { t: a.t0 + k * a.period, who: people[h].name };
      }
    }
    return a.n === b.n ? null : { t: a.t0 + n * a.period, who: "the end" };
  }

  /* ---- charts ---- */

  function ticks(low, high, most) {
    let step = Math.pow(10, Math.floor(Math.log10((high - low) / most)));
    for (const factor of [1, 2, 5, 10]) if ((high - low) / (step * factor) <= most) { step *= factor; break; }
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9; k++) found.push(+(k * step).toFixed(9));
    return found;
  }

  /** A line chart over time. `spec`: label, lines [{t, value, class}], limit, unit, floor (always shown), cut (top). */
  function chart(host, spec, span, onSeek) {
    host.textContent = "";
    const width = Math.max(280, host.clientWidth || 560), height = spec.last ? 142 : 118;
    const x0 = 46, x1 = width - 8, y0 = 24, y1 = height - (spec.last ? 36 : 12);
    const box = svg(host, "svg", { class: "rp-chart", viewBox: "0 0 " + width + " " + height, width: width, height: height, role: "img" });
    let low = Infinity, high = -Infinity;
    spec.lines.forEach(function (line) {
      line.value.forEach(function (v) { if (v !== null && isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); } });
    });
    if (spec.limit !== null && spec.limit !== undefined) { low = Math.min(low, spec.limit); high = Math.max(high, spec.limit); }
    if (spec.floor !== undefined) { low = Math.min(low, spec.floor); high = Math.max(high, spec.floor); }
    const cut = spec.cut !== undefined && high > spec.cut;
    if (cut) high = spec.cut;
    if (!isFinite(low)) { low = 0; high = 1; }
    const air = (high - low) * 0.08 || Math.abs(high) * 0.1 || 1;
    low -= air; if (!cut) high += air;
    const px = function (t) { return x0 + (x1 - x0) * clamp((t - span[0]) / (span[1] - span[0] || 1), 0, 1); };
    const py = function (v) { return y1 + (y0 - y1) * (clamp(v, low, high) - low) / (high - low); };
    svg(box, "title", {}, spec.label);
    svg(box, "text", { class: "rp-label", x: 0, y: 13 }, spec.label + (cut ? " (above " + spec.cut + " " + spec.unit + " not drawn)" : ""));
    if (spec.shade !== undefined && low < spec.shade)
      svg(box, "rect", { class: "rp-shade", x: x0, y: py(spec.shade), width: x1 - x0, height: Math.max(0, y1 - py(spec.shade)) });
    ticks(low, high, 4).forEach(function (v) {
      svg(box, "line", { class: "rp-grid", x1: x0, x2: x1, y1: py(v), y2: py(v) });
      svg(box, "text", { class: "rp-axis", x: x0 - 6, y: py(v) + 4, "text-anchor": "end" }, String(v));
    });
    if (spec.last) {
      ticks(span[0], span[1], Math.max(3, Math.floor(width / 80))).forEach(function (t) {
        svg(box, "text", { class: "rp-axis", x: px(t), y: y1 + 16, "text-anchor": "middle" }, String(t));
      });
      svg(box, "text", { class: "rp-axis", x: (x0 + x1) / 2, y: height - 4, "text-anchor": "middle" }, "time, s");
    }
    spec.lines.forEach(function (line) {
      let path = "", pen = "M";
      line.value.forEach(function (v, k) {
        if (v === null || !isFinite(v)) { pen = "M"; return; }
        path += pen + px(line.t[k]).toFixed(1) + " " + py(v).toFixed(1); pen = "L";
      });
      svg(box, "path", { class: "rp-line " + line.class, d: path || "M0 0" });
    });
    if (spec.limit !== null && spec.limit !== undefined) {
      svg(box, "line", { class: "rp-limit", x1: x0, x2: x1, y1: py(spec.limit), y2: py(spec.limit) });
      const away = function (line, from, to) { return Math.min.apply(null, line.value.slice(Math.floor(from * line.value.length), Math.ceil(to * line.value.length)).filter(function (v) { return v !== null; }).map(function (v) { return Math.abs(v - spec.limit); }).concat([high - low])); };
      const atLeft = spec.lines.length > 0 && away(spec.lines[0], 0, 0.3) > away(spec.lines[0], 0.7, 1);
      svg(box, "text", { class: "rp-limit-text", x: atLeft ? x0 + 4 : x1, y: py(spec.limit) + (py(spec.limit) > y0 + 16 ? -5 : 14), "text-anchor": atLeft ? "start" : "end" },
        "limit " + number(spec.limit, spec.unit));
    }
    const cursor = svg(box, "line", { class: "rp-cursor", y1: y0, y2: y1 });
    const mark = svg(box, "circle", { class: "rp-mark", r: 4 });
    scrub(box, function (x) { onSeek(span[0] + (x * width / box.clientWidth - x0) / (x1 - x0) * (span[1] - span[0])); });
    return function (t, value) {
      cursor.setAttribute("x1", px(t)); cursor.setAttribute("x2", px(t));
      mark.style.display = value === null || value === undefined ? "none" : "";
      if (value !== null && value !== undefined) { mark.setAttribute("cx", px(t)); mark.setAttribute("cy", py(value)); }
    };
  }
  function scrub(node, seek) {
    function pick(event) { seek(event.clientX - node.getBoundingClientRect().left); }
    node.addEventListener("pointerdown", function (event) { node.setPointerCapture(event.pointerId); pick(event); });
    node.addEventListener("pointermove", function (event) { if (event.buttons) pick(event); });
  }

  /* ---- the component ---- */

  /** The floor plan of SVG text as an element; text that is no SVG gives an empty plan. */
  function planOf(text) {
    const read = text ? new DOMParser().parseFromString(text, "image/svg+xml").documentElement : null;
    return read && read.localName === "svg" ? document.importNode(read, true) : svg(null, "svg", { viewBox: "-10 -10 20 20" });
  }

  let mounted = 0;
  function mount(element, data, options) {
    options = Object.assign({ map: null, address: false, keys: element }, options);
    const gone = new AbortController(), signal = gone.signal;
    const byRun = new Map();
    data.groups.forEach(function (group) { group.runs.forEach(function (run) { if (!byRun.has(run.id)) byRun.set(run.id, group); }); });
    const first = data.groups.find(function (group) { return group.runs.length; });
    if (!first) { element.textContent = "No run to replay."; return null; }
    const [ma, mb, mc, md, me, mf] = data.matrix;
    const P = function (x, y) { return [ma * x + mc * y + me, mb * x + md * y + mf]; };
    const cache = new Map();
    const state = { group: null, run: null, series: null, t: 0, playing: false, speed: 1, other: null, otherSeries: null, marked: [], token: 0 };
    const show = { grid: false, trails: true, follow: false };
    let shownBox = null, cropped = !!options.stage;  /* the part of the plan that is shown; whether it follows the choice of a run */
    let updates = [], lastFrame = null, ready = Promise.resolve();

    /* layout */
    element.classList.add("rp");
    const top = html(element, "div", { class: "rp-top" });
    const groupLabel = html(top, "label", { class: "rp-field" }, "Scenario ");
    const groupSelect = html(groupLabel, "select", {});
    data.groups.forEach(function (group, k) { if (group.runs.length) html(groupSelect, "option", { value: k }, group.label); });
    const compareLabel = html(top, "label", { class: "rp-field" }, "Compare with ");
    const compareSelect = html(compareLabel, "select", {});
    const chosen = html(element, "p", { class: "rp-chosen" });
    const chosenText = html(chosen, "span", {}), before = html(chosen, "button", { type: "button" }, "Previous"), after = html(chosen, "button", { type: "button" }, "Next"), clear = html(chosen, "button", { type: "button" }, "Clear");
    const stripBox = html(element, "div", { class: "rp-strip-box" });
    const strip = html(stripBox, "div", { class: "rp-strip", role: "radiogroup", "aria-label": "Runs by the value of the requirement" });
    const about = html(element, "p", { class: "rp-about" });
    const body = html(element, "div", { class: "rp-body" });
    const left = html(options.stage || body, "div", { class: "rp-left" }), right = html(body, "div", { class: "rp-right" });
    const mapBox = html(left, "div", { class: "rp-map" });
    const map = options.map || planOf(data.floor);
    map.classList.add("map");
    if (options.stage) map.classList.add("rp-wide");
    mapBox.appendChild(map);
    const whole = map.getAttribute("viewBox").split(/[ ,]+/).map(Number);
    const ground = svg(map, "g", { id: "rp-ground-" + ++mounted });  /* the film strip shows it again */
    Array.from(map.children).forEach(function (node) { if (!["text", "style", "title"].includes(node.localName) && node !== ground && !node.matches(".area-names")) ground.appendChild(node); });
    map.insertBefore(ground, map.querySelector(":scope > text, :scope > .area-names"));
    const grid = svg(map, "g", { class: "rp-grid-points" }), layered = svg(map, "g", { class: "rp-layers" }), drawn = svg(map, "g", { class: "rp-drawn" });
    const lanes = html(left, "div", { class: "rp-lanes" });
    const controls = html(left, "div", { class: "rp-controls" });
    const back = html(controls, "button", { type: "button", "aria-label": "One second back" }, "\u2212 1 s");
    const playButton = html(controls, "button", { type: "button", class: "rp-play" }, "Play");
    const forth = html(controls, "button", { type: "button", "aria-label": "One second on" }, "+ 1 s");
    const slider = html(controls, "input", { type: "range", min: 0, max: 1, step: 0.1, value: 0, "aria-label": "Time in the run" });
    const speedSelect = html(controls, "select", { "aria-label": "Playback speed" });
    SPEEDS.forEach(function (speed) { html(speedSelect, "option", { value: speed }, speed + "\u00d7"); });
    speedSelect.value = "1";
    const toggles = html(left, "div", { class: "rp-controls" });
    const decisive = html(toggles, "button", { type: "button" }, "Decisive moment");
    const switches = {};
    [["follow", "Follow the robot"], ["trails", "Trails"], ["grid", "Waypoints"]].forEach(function (each) {
      const label = html(toggles, "label", { class: "rp-switch" });
      const box = html(label, "input", { type: "checkbox" });
      label.appendChild(document.createTextNode(" " + each[1]));
      box.checked = show[each[0]];
      box.addEventListener("change", function () { show[each[0]] = box.checked; frame(); draw(); });
      switches[each[0]] = box;
    });
    const film = html(left, "div", { class: "rp-film", "aria-hidden": "true" });
    const zooms = html(mapBox, "div", { class: "rp-zoom" });
    [["\u2212", "Zoom out", 1.25], ["+", "Zoom in", 0.8]].forEach(function (each) {
      html(zooms, "button", { type: "button", "aria-label": each[1] }, each[0]).addEventListener("click", function () { zoom(each[2], 0.5, 0.5); });
    });
    html(zooms, "button", { type: "button" }, "Fit").addEventListener("click", function () { look(null); });
    const layerSwitches = html(left, "div", { class: "rp-controls rp-layer-switches", role: "group", "aria-label": "Layers" });
    const tools = html(options.stage ? element : left, "div", { class: "rp-controls rp-tools" });
    const now = html(options.stage ? left : right, "p", { class: "rp-now" });
    const moments = html(right, "div", { class: "rp-moments" });
    const charts = html(right, "div", { class: "rp-charts" });
    const tasks = html(right, "div", { class: "rp-tasks" });
    html(right, "p", { class: "rp-help" }, "Keys: space plays, \u2190 \u2192 step 0.1 s (with Shift 1 s), [ ] choose the run, + \u2212 the speed, d goes to the decisive moment, f follows the robot. Click the map, then the wheel zooms it; drag moves it. Click or drag in a chart to go to a moment.");

    /* map */
    function scale() {
      const box = map.getAttribute("viewBox").split(/[ ,]+/).map(Number);
      const width = map.clientWidth || 600, height = map.clientHeight || 400;
      return Math.min(width / box[2], height / box[3]);
    }
    const names = Array.from(map.querySelectorAll("text.area-name")).map(function (node) {
      const spans = Array.from(node.querySelectorAll("tspan"));
      const ys = spans.map(function (s) { return +s.getAttribute("y"); });
      spans.forEach(function (s) { s.removeAttribute("dy"); });
      const x = spans.length ? +spans[0].getAttribute("x") : +node.getAttribute("x");
      const y = ys.length ? ys.reduce(function (a, b) { return a + b; }, 0) / ys.length : +node.getAttribute("y");
      const longest = Math.max.apply(null, spans.map(function (s) { return s.textContent.length; }).concat([1]));
      return { node: node, spans: spans, x: x, y: y, size: +node.getAttribute("font-size") || 0.4, longest: longest, turned: node.hasAttribute("transform") };
    });
    let areas = [];  /* where the names of areas stand */
    /** Keep every name readable: at least 11.5 px, and hidden rather than cut or over another name. */
    function fit() {
      const k = scale(), taken = areas = [], seen = map.getAttribute("viewBox").split(/[ ,]+/).map(Number);
      names.forEach(function (name) {
        const size = Math.min(Math.max(name.size, SMALLEST_PX / k), LARGEST_PX / k);
        name.node.style.fontSize = size + "px";
        name.spans.forEach(function (span, i) { span.setAttribute("y", name.y + (i - (name.spans.length - 1) / 2) * size * 1.14); });
        let w = name.longest * size * 0.65, h = name.spans.length * size * 1.2;
        if (name.turned) [w, h] = [h, w];
        const x = w < seen[2] && !name.turned ? clamp(name.x, seen[0] + w / 2, seen[0] + seen[2] - w / 2) : name.x;
        if (!name.turned) name.spans.forEach(function (span) { span.setAttribute("x", x); });
        const box = [x - w / 2, name.y - h / 2, x + w / 2, name.y + h / 2];
        const inside = Math.abs(x - name.x) <= w / 2 && box[1] >= seen[1] && box[3] <= seen[1] + seen[3] && (!name.turned || box[0] >= seen[0] && box[2] <= seen[0] + seen[2]);
        const free = inside && apart(box, taken);
        name.node.style.display = free ? "" : "none";
        if (free) taken.push(box);
      });
      grid.querySelectorAll("text").forEach(function (node) { node.style.display = k > 55 ? "" : "none"; node.style.fontSize = SMALLEST_PX / k + "px"; node.setAttribute("dy", 14 / k); });
      drawn.querySelectorAll("text").forEach(function (node) { node.style.fontSize = 12.5 / k + "px"; });
    }
    function frame() {
      if (show.grid && !grid.firstChild) (data.waypoints || []).forEach(function (w) {
        const p = P(w[1], w[2]);
        svg(svg(grid, "circle", { cx: p[0], cy: p[1], r: 0.06 }), "title", {}, w[0]);
        svg(grid, "text", { x: p[0], y: p[1] }, w[0]);
      });
      grid.style.display = show.grid ? "" : "none";
      if (!show.follow || !state.series) map.setAttribute("viewBox", (shownBox || whole).join(" "));
      else {
        const at0 = P(at(state.series.x, state.series, state.t), at(state.series.y, state.series, state.t));
        const width = Math.min(whole[2], 10), height = Math.min(whole[3], width * (options.stage ? 0.62 : whole[3] / whole[2]));
        map.setAttribute("viewBox", [at0[0] - width / 2, at0[1] - height / 2, width, height].join(" "));
      }
      fit();
    }
    /** Show a part of the plan; null shows all of it. */
    function look(box) { shownBox = box; cropped = false; if (show.follow) switches.follow.click(); else { frame(); draw(); } }
    function zoom(factor, atX, atY) {
      const b = map.getAttribute("viewBox").split(/[ ,]+/).map(Number), w = clamp(b[2] * factor, 2, whole[2]), h = w * b[3] / b[2];
      look(w >= whole[2] ? null : [b[0] + (b[2] - w) * atX, b[1] + (b[3] - h) * atY, w, h]);
    }
    /** The encounter: the robot and who is nearest to it, with their surroundings. */
    function encounter(series, t) {
      const robot = P(at(series.x, series, t), at(series.y, series, t)), h = nearest(series, t);
      const other = h < 0 ? robot : P(at(series.people[h].x, series, t), at(series.people[h].y, series, t));
      const w = Math.min(whole[2], Math.max(9, 2.5 * Math.hypot(other[0] - robot[0], other[1] - robot[1]))), high = Math.min(whole[3], w * 0.62);
      return [clamp((robot[0] + other[0] - w) / 2, whole[0], whole[0] + whole[2] - w), clamp((robot[1] + other[1] - high) / 2, whole[1], whole[1] + whole[3] - high), w, high];
    }
    map.setAttribute("tabindex", "0");
    map.addEventListener("wheel", function (event) {
      if (document.activeElement !== map && !event.ctrlKey) return;
      const box = map.getBoundingClientRect();
      event.preventDefault();
      zoom(event.deltaY > 0 ? 1.25 : 0.8, (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    }, { passive: false, signal: signal });
    map.addEventListener("pointermove", function (event) {
      if (!event.buttons || event.pointerType === "touch" || !shownBox) return;
      const k = scale();
      look([shownBox[0] - event.movementX / k, shownBox[1] - event.movementY / k, shownBox[2], shownBox[3]]);
    }, { signal: signal });

    /* layers */
    const layers = [];
    function view() {
      return {
        run: state.run.id, t: state.t, scale: scale(), point: P, node: svg,
        matrix: function (x, y) { const p = P(x, y); return "matrix(" + [ma, mb, mc, md, p[0], p[1]].join(" ") + ")"; },
      };
    }
    function addLayer(layer) {
      const label = html(null, "label", { class: "rp-switch" }), box = html(label, "input", { type: "checkbox" });
      label.appendChild(document.createTextNode(" " + layer.label));
      box.checked = !!layer.shown;
      const group = svg(layered, "g", { class: "rp-layer-" + layer.id });
      layerSwitches.appendChild(label);
      layers.push({ layer: layer, label: label, box: box, group: group });
      box.addEventListener("change", draw);
      if (state.series) draw();
    }
    function drawLayers() {
      const seen = view();
      let any = false;
      layers.forEach(function (each) {
        const has = each.layer.has(state.run.id), on = has && each.box.checked;
        any = any || has;
        each.label.style.display = has ? "" : "none";
        each.group.style.display = on ? "" : "none";
        if (on) each.layer.draw(each.group, seen);
      });
      layerSwitches.style.display = any ? "" : "none";
    }

    let parts = {};
    function actor(kind, person, parent) {
      const node = svg(parent || drawn, "g", { class: kind });
      if (person) {
        node.style.color = person.colour || "var(--rp-far, #8a94a0)";
        if (person.outline) svg(node, "polygon", { points: person.outline.map(function (p) { return p.join(","); }).join(" ") });
        svg(node, "circle", { r: person.radius });
        svg(node, "path", { class: "rp-nose", d: "M" + person.radius * 0.95 + " 0L" + person.radius * 0.2 + " " + person.radius * 0.6 + "L" + person.radius * 0.2 + " " + -person.radius * 0.6 + "Z" });
        svg(node, "title", {}, person.name);
      } else {
        const robot = state.group.robot;
        if (robot.outline.length) svg(node, "polygon", { points: robot.outline.map(function (p) { return p.join(","); }).join(" ") });
        else svg(node, "circle", { r: robot.radius });
        const half = robot.outline.length ? Math.max.apply(null, robot.outline.map(function (p) { return p[0]; })) : robot.radius;
        svg(node, "path", { class: "rp-nose", d: "M" + half * 0.9 + " 0L" + half * 0.1 + " " + half * 0.5 + "L" + half * 0.1 + " " + -half * 0.5 + "Z" });
        svg(node, "title", {}, "robot");
      }
      return node;
    }
    function put(node, series, who, t) {
      const p = P(at(who.x, series, t), at(who.y, series, t));
      node.setAttribute("transform", "matrix(" + [ma, mb, mc, md, p[0], p[1]].join(" ") + ") rotate(" + at(who.yaw, series, t) * 180 / Math.PI + ")");
      return p;
    }
    function points(who, end) {
      let text = "";
      for (let k = 0; k < end; k++) { const p = P(who.x[k], who.y[k]); text += p[0].toFixed(2) + "," + p[1].toFixed(2) + " "; }
      return text;
    }
    function cast(series, ghost) {
      const suffix = ghost ? " rp-ghost" : "";
      const found = { people: [] };
      const trail = function (who, colour, kind) {
        const line = svg(drawn, "polyline", { class: "rp-trail " + kind + suffix, points: points(who, series.n) });
        const past = ghost ? null : svg(drawn, "polyline", { class: "rp-trail rp-past " + kind });
        if (colour) { line.style.color = colour; if (past) past.style.color = colour; }
        return past;
      };
      map.classList.toggle("rp-many", state.group.people.filter(function (person) { return person.colour; }).length > MANY);
      found.robotPast = trail(series, null, "rp-of-robot");
      state.group.people.forEach(function (person, h) {
        if (!series.people[h]) { found.people.push(null); return; }
        found.people.push({ past: person.colour ? trail(series.people[h], person.colour, "rp-of-person") : null, who: series.people[h], person: person });
      });
      if (!ghost) found.near = svg(drawn, "line", { class: "rp-near" });
      found.people.forEach(function (each) { if (each) each.node = actor("rp-person" + (each.person.colour ? "" : " rp-uninvolved") + suffix, each.person); });
      found.robot = actor("rp-robot" + suffix, null);
      if (!ghost) found.people.forEach(function (each) { if (each && each.person.colour) { each.leader = svg(drawn, "line", { class: "rp-leader" }); each.name = svg(drawn, "text", { class: "rp-name" }, each.person.name); } });
      return found;
    }
    let leaves = [], ends = [];
    function corners(outline) { return outline.map(function (q) { return P(q[0], q[1]).join(","); }).join(" "); }
    function opened(door, moves, t) {
      let share = 0;
      (moves || []).forEach(function (move) {
        const way = (Math.min(t, move[3]) - move[0]) / door.opening;
        if (move[0] <= t) share = clamp(move[1] + (move[2] ? way : -way), 0, 1);
      });
      return share;
    }
    function placeLeaves(t) {
      const moves = state.run.doors || {};
      leaves.forEach(function (each) {
        const last = each.door.leaf.length - 1;
        each.node.setAttribute("points", corners(each.door.leaf[Math.round(opened(each.door, moves[each.door.name], t) * last)]));
      });
    }
    function redraw() {
      drawn.textContent = "";
      (state.group.moved || []).forEach(function (outline) { svg(drawn, "polygon", { class: "rp-moved", points: corners(outline) }); });
      leaves = (data.doors || []).map(function (door) { return { door: door, node: svg(drawn, "polygon", { class: "rp-door" }) }; });
      const s = P(data.route.start[0], data.route.start[1]), g = P(data.route.goal[0], data.route.goal[1]);
      svg(drawn, "circle", { class: "rp-end", cx: s[0], cy: s[1], r: 0.2 });
      svg(drawn, "rect", { class: "rp-end", x: g[0] - 0.2, y: g[1] - 0.2, width: 0.4, height: 0.4 });
      data.route.through.forEach(function (q) { const p = P(q[0], q[1]); svg(drawn, "circle", { class: "rp-end", cx: p[0], cy: p[1], r: 0.1 }); });
      ends = [["start", s], ["goal", g]].map(function (each) {
        return { at: each[1], leader: svg(drawn, "line", { class: "rp-leader" }), name: svg(drawn, "text", { class: "rp-end-name" }, each[0]) };
      });
      parts = { ghost: state.otherSeries ? cast(state.otherSeries, true) : null, main: cast(state.series, false) };
    }
    function nearest(series, t) {
      const k = Math.floor((t - series.t0) / series.period + 1e-6);
      let who = -1;
      series.near.forEach(function (change) { if (change[0] <= Math.max(k, 0)) who = change[1]; });
      return who;
    }
    const WAYS = [[0, -1], [0, 1], [1, 0], [-1, 0], [1, -1], [-1, -1], [1, 1], [-1, 1]];
    /** Put the names of people, the nearest first, and "start" and "goal" where they cover neither each other nor a body, else hide them; `far` ones get a line. */
    function label(actors, robot, unit) {
      const shown = map.getAttribute("viewBox").split(/[ ,]+/).map(Number), size = 12.5 / unit, air = 3 / unit, taken = [];
      const boxed = function (x, y, rx, ry) { return [x - rx, y - ry, x + rx, y + ry]; };
      const free = function (box) {
        return box[0] >= shown[0] && box[1] >= shown[1] && box[2] <= shown[0] + shown[2] && box[3] <= shown[1] + shown[3] && apart(box, taken);
      };
      const put = function (each, at, radius, first) {
        const rx = each.name.textContent.length * size * 0.31, ry = size * 0.6, tries = [];
        [radius + air, 2.5 * radius + 4 * air, 4 * radius + 10 * air].forEach(function (away, ring) {
          WAYS.forEach(function (way, k) {
            const x = at[0] + way[0] * (away + rx), y = at[1] + way[1] * (away + ry);
            tries.push({ key: 8 * ring + k, x: x, y: y, box: boxed(x, y, rx, ry), far: ring > 0 });
          });
        });
        const before = tries[each.placed || 0];  /* a name stays where it is as long as it can */
        const clear = function (one) { return free(one.box) && apart(one.box, areas); };
        const inside = at[0] >= shown[0] && at[1] >= shown[1] && at[0] <= shown[0] + shown[2] && at[1] <= shown[1] + shown[3];
        const found = inside && (clear(before) && !before.far ? before : tries.find(clear) || (first && tries.find(function (one) { return free(one.box); })));
        each.name.style.display = found ? "" : "none";
        if (!found) { each.leader.style.display = "none"; return; }
        each.placed = found.key;
        taken.push(found.box);
        each.name.setAttribute("x", found.x); each.name.setAttribute("y", found.y + size * 0.35);
        each.leader.style.display = found.far ? "" : "none";
        each.leader.setAttribute("x1", at[0]); each.leader.setAttribute("y1", at[1]); 
        const back = Math.min(rx / Math.abs(found.x - at[0]), ry / Math.abs(found.y - at[1]), 1);  /* as far as the name */
        each.leader.setAttribute("x2", found.x + (at[0] - found.x) * back); each.leader.setAttribute("y2", found.y + (at[1] - found.y) * back);
      };
      const reach = state.group.robot.outline.reduce(function (most, q) { return Math.max(most, Math.hypot(q[0], q[1])); }, state.group.robot.radius);
      const named = actors.people.filter(function (each) { return each && each.name; });
      taken.push(boxed(robot[0], robot[1], reach, reach));
      named.forEach(function (each) { taken.push(boxed(each.at[0], each.at[1], each.person.radius, each.person.radius)); });
      const away = function (each) { return Math.hypot(each.at[0] - robot[0], each.at[1] - robot[1]); };
      named.sort(function (a, b) { return away(a) - away(b); }).forEach(function (each, k) { put(each, each.at, each.person.radius, k === 0); });
      ends.forEach(function (each) { put(each, each.at, 0.2); });
    }
    function place(actors, series, t) {
      const k = Math.floor(clamp((t - series.t0) / series.period, 0, series.n - 1)) + 1, unit = scale();
      const robot = put(actors.robot, series, series, t);
      if (actors.robotPast) actors.robotPast.setAttribute("points", show.trails ? points(series, k) : "");
      actors.people.forEach(function (each) {
        if (!each) return;
        const p = put(each.node, series, each.who, t);
        if (each.past) each.past.setAttribute("points", show.trails ? points(each.who, k) : "");
        each.at = p;
      });
      if (actors.robotPast) label(actors, robot, unit);
      if (actors.near) {
        const h = nearest(series, t);
        actors.near.style.display = h < 0 ? "none" : "";
        actors.people.forEach(function (each, k) { if (each && each.past) each.past.classList.toggle("rp-nearest", k === h); });
        if (h >= 0) {
          const p = P(at(series.people[h].x, series, t), at(series.people[h].y, series, t));
          actors.near.setAttribute("x1", robot[0]); actors.near.setAttribute("y1", robot[1]);
          actors.near.setAttribute("x2", p[0]); actors.near.setAttribute("y2", p[1]);
        }
      }
    }

    /* charts and lanes */
    function times(series) { return Array.from({ length: series.n }, function (_, k) { return series.t0 + k * series.period; }); }
    function redrawCharts() {
      charts.textContent = ""; updates = [];
      const span = [Math.min(state.series.t0, state.otherSeries ? state.otherSeries.t0 : Infinity), Math.max(state.series.end, state.otherSeries ? state.otherSeries.end : 0)];
      const both = function (of) { return [[state.series, state.run, "rp-a"], [state.otherSeries, state.other, "rp-b"]].filter(function (e) { return e[0]; }).map(function (e) { const line = of(e[0], e[1]); return line && { t: line.t, value: line.value, class: e[2] }; }).filter(Boolean).reverse(); };
      const r = data.requirement;
      const judged = both(function (_, run) { return run.judged; });
      if (judged.length || r.limit !== null)
        updates.push([chart(html(charts, "div", {}), { label: r.quantity + (r.unit ? ", " + r.unit : ""), lines: judged, limit: r.limit, unit: r.unit }, span, goTo), function (t) { return state.run.judged ? curveAt(state.run.judged, t) : null; }]);
      if (state.run.present.length)
        updates.push([chart(html(charts, "div", {}), { label: "gap to the nearest person, m", lines: both(function (s) { return { t: times(s), value: Array.from(s.gap) }; }), floor: 0, shade: 0, cut: 5, unit: "m" }, span, goTo), function (t) { return at(state.series.gap, state.series, t); }]);
      updates.push([chart(html(charts, "div", {}), { label: "speed of the robot, m/s", lines: both(function (s) { return { t: times(s), value: Array.from(s.v) }; }), floor: 0, unit: "m/s", last: true }, span, goTo), function (t) { return at(state.series.v, state.series, t); }]);
    }
    /** Small pictures of the robot and its surroundings at equal times; click or drag to go there. */
    let filmCursor = null;
    function redrawFilm() {
      film.textContent = "";
      const series = state.series, width = film.clientWidth || 560, count = Math.min(FRAMES, Math.max(3, Math.floor(width / 80))), span = series.end - series.t0;
      for (let k = 0; k < count; k++) {
        const t = series.t0 + span * (k + 0.5) / count, p = P(at(series.x, series, t), at(series.y, series, t));
        const box = svg(film, "svg", { viewBox: [p[0] - 3, p[1] - 2, 6, 4].join(" ") });
        svg(box, "use", { href: "#" + ground.id });
        state.group.people.forEach(function (person, h) {
          if (series.people[h]) put(actor("rp-person", person, box), series, series.people[h], t);
        });
        put(actor("rp-robot", null, box), series, series, t);
        html(film, "span", { style: "left:" + 100 * (k + 0.5) / count + "%" }, t.toFixed(0) + " s");
      }
      filmCursor = html(film, "i", {});
      filmCursor.place = function (t) { filmCursor.style.left = 100 * (span ? (t - series.t0) / span : 0) + "%"; };
    }
    scrub(film, function (x) { if (state.series) { pause(); goTo(state.series.t0 + x / film.clientWidth * (state.series.end - state.series.t0)); } });
    let laneCursor = null;
    function redrawLanes() {
      lanes.textContent = "";
      const series = state.series, width = Math.max(280, lanes.clientWidth || 560), x0 = 72, x1 = width - 4, row = 15;
      const rows = LANES.filter(function (lane) { return lane[0] === "gap" ? state.run.present.length : (state.run.lanes[lane[0]] || []).length; });
      const box = svg(lanes, "svg", { class: "rp-chart", viewBox: "0 0 " + width + " " + (rows.length * row + 20), width: width, height: rows.length * row + 20, role: "img" });
      svg(box, "title", {}, "Timeline: " + rows.map(function (lane) { return lane[1]; }).join(", "));
      const px = function (t) { return x0 + (x1 - x0) * (t - series.t0) / (series.end - series.t0 || 1); };
      rows.forEach(function (lane, k) {
        const y = 14 + k * row;
        svg(box, "text", { class: "rp-axis", x: x0 - 8, y: y + 10, "text-anchor": "end" }, lane[1]);
        svg(box, "rect", { class: "rp-lane", x: x0, y: y + 1, width: x1 - x0, height: row - 4 });
        if (lane[0] === "gap") {
          const step = Math.max(1, Math.ceil(series.n / 240));
          for (let k0 = 0; k0 < series.n; k0 += step) {
            let least = Infinity;
            for (let k1 = k0; k1 < Math.min(k0 + step, series.n); k1++) least = Math.min(least, series.gap[k1]);
            const near = clamp(1 - least / 2, 0, 1);
            if (near > 0) svg(box, "rect", { class: "rp-lane-gap", x: px(series.t0 + k0 * series.period), y: y + 1, width: Math.max(1, (x1 - x0) * step / series.n + 0.3), height: row - 4, opacity: near.toFixed(2) });
          }
        } else state.run.lanes[lane[0]].forEach(function (spell) {
          const bar = svg(box, "rect", { class: "rp-lane-" + lane[0], x: px(spell[0]), y: y + 1, width: Math.max(2, px(spell[1]) - px(spell[0])), height: row - 4 });
          svg(bar, "title", {}, lane[1] + " " + spell[0].toFixed(1) + " to " + spell[1].toFixed(1) + " s");
        });
      });
      const opens = svg(box, "path", { class: "rp-opens", d: "M" + px(state.run.opens) + " 12l-5 -8h10z" });
      svg(opens, "title", {}, "decisive moment, " + state.run.opens.toFixed(1) + " s");
      state.run.moments.forEach(function (moment) { const tick = svg(box, "circle", { class: "rp-tick", cx: px(moment[0]), cy: 8, r: 3 }); svg(tick, "title", {}, moment[0].toFixed(1) + " s: " + moment[1]); });
      laneCursor = svg(box, "line", { class: "rp-cursor", y1: 0, y2: rows.length * row + 16 });
      laneCursor.place = function (t) { laneCursor.setAttribute("x1", px(t)); laneCursor.setAttribute("x2", px(t)); };
      scrub(box, function (x) { goTo(series.t0 + (x * width / box.clientWidth - x0) / (x1 - x0) * (series.end - series.t0)); });
      tasks.textContent = "";
      state.group.people.forEach(function (person) {
        if (!person.tasks) return;
        const fold = html(tasks, "details", {}), head = html(fold, "summary", {});
        html(head, "span", { class: "dot" }).style.background = person.colour || "#8a94a0";
        head.appendChild(document.createTextNode(person.name + ": " + person.manner + (person.colour ? "" : "; never within 2 m")));
        const list = html(fold, "ul", { class: "tasks" });
        person.tasks.forEach(function (task) { html(list, "li", {}, task); });
      });
      moments.textContent = "";
      if (state.run.moments.length) {
        const list = html(moments, "ol", {});
        state.run.moments.forEach(function (moment) {
          const item = html(list, "li", {});
          const button = html(item, "button", { type: "button", class: "rp-link" }, moment[0].toFixed(1) + " s");
          button.addEventListener("click", function () { pause(); goTo(Math.ceil(10 * moment[0] - 1e-6) / 10); });
          item.appendChild(document.createTextNode(" " + moment[1]));
        });
      }
    }

    /* strip of runs */
    function redrawStrip() {
      strip.textContent = "";
      const group = state.group, limit = data.requirement.limit;
      const values = group.runs.map(function (run) { return run.objective; }).filter(function (v) { return v !== null; });
      if (limit !== null) values.push(limit);
      let low = Math.min.apply(null, values), high = Math.max.apply(null, values);
      if (!values.length) { low = 0; high = 1; }
      const air = (high - low) * 0.06 || Math.abs(high) * 0.1 || 1;
      low -= air; high += air;
      const width = strip.clientWidth || 600, size = group.runs.length > 12 ? 14 : 24, stacks = {};
      let rows = 1;
      group.runs.map(function (run, k) { return [run, k]; }).sort(function (a, b) { return (a[0].objective || 0) - (b[0].objective || 0); }).forEach(function (each) {
        const run = each[0], none = run.objective === null;
        if (none && strip.querySelector(".rp-none")) return;  /* runs without a value: one mark */
        const x = none ? 1 : (run.objective - low) / (high - low);
        const left0 = Math.round(x * (width - size - 8)) + 4;
        let level = 0;
        while ((stacks[level] === undefined ? -Infinity : stacks[level]) > left0) level++;
        stacks[level] = left0 + size - 3; rows = Math.max(rows, level + 1);
        const dot = html(strip, "button", { type: "button", role: "radio", class: "rp-dot" + (none ? " rp-none" : "") + (run.violated ? " rp-bad" : "") + (state.marked.includes(run.id) ? " rp-marked" : ""), "data-run": run.id,
          "aria-checked": run === state.run ? "true" : "false", tabindex: run === state.run ? 0 : -1,
          "aria-label": title(run), title: title(run) });
        dot.style.left = left0 + "px"; dot.dataset.level = level;
        dot.addEventListener("click", function () { pause(); select(run.id); });
      });
      const without = group.runs.filter(function (run) { return run.objective === null; }).length, mark = strip.querySelector(".rp-none");
      if (without > 1) mark.title = without + " runs without a value; the first: " + mark.title;
      const rise = Math.min(size - 6, 28 / Math.max(1, rows - 1));  /* at most 72 px in all */
      strip.classList.toggle("rp-dense", size < 24);
      strip.querySelectorAll(".rp-dot").forEach(function (dot) { dot.style.bottom = dot.dataset.level * rise + 16 + "px"; });
      strip.style.height = Math.min(72, (rows - 1) * rise + size + 18) + (limit === null ? 0 : 16) + "px";  /* 16: its label */
      ticks(low, high, Math.max(2, Math.floor(width / 110))).forEach(function (v, k) {
        const tick = html(strip, "span", { class: "rp-strip-tick", "aria-hidden": "true" }, String(v) + (k ? "" : " " + data.requirement.unit));
        tick.style.left = Math.round((v - low) / (high - low) * (width - size - 8)) + 4 + size / 2 + "px";
      });
      if (limit !== null) {
        const x = Math.round((limit - low) / (high - low) * (width - size - 8)) + 4 + size / 2;
        const line = html(strip, "span", { class: "rp-strip-limit", "aria-hidden": "true" });
        line.style.left = x + "px";
        const text = html(strip, "span", { class: "rp-strip-text", "aria-hidden": "true" }, "limit: " + data.requirement.limitText);
        if (x > width / 2) text.style.right = width - x + 5 + "px"; else text.style.left = x + 5 + "px";
      }
    }
    function title(run) {
      return run.said + (run.violated ? ", violated" : "") + (run.arrived ? "" : ", did not arrive") + (run.note ? ", " + run.note : "") + ", seed " + run.seed;
    }
    /** The runs that Next and Previous go through: those marked by the address, else those of the configuration. */
    function ordered() { return state.marked.length > 1 && state.marked.includes(state.run.id) ? state.marked : state.group.runs.map(function (run) { return run.id; }); }
    function step(by) {
      const runs = ordered(), k = runs.indexOf(state.run.id);
      pause();
      return select(runs[(k + by + runs.length) % runs.length]);
    }

    /* moving through time */
    function say() {
      const s = state.series, t = state.t, r = data.requirement;
      let text = t.toFixed(1) + " s of " + s.end.toFixed(1) + " s. Robot " + (Math.round(at(s.v, s, t) * 100) / 100 + 0).toFixed(2) + " m/s.";
      const h = nearest(s, t);
      if (h >= 0) {
        const gap = at(s.gap, s, t);
        const touching = gap <= 0 || gap < SHORT_M && (state.run.lanes.contact || []).some(function (c) { return c[0] <= t + 1e-6 && t - s.period <= c[1]; });
        text += " Nearest: " + state.group.people[h].name + ", " + (touching ? "in contact" : gap < 1 ? Math.max(1, Math.round(gap * 100)) + " cm away" : gap.toFixed(1) + " m away") + ".";
      }
      const judged = state.run.judged ? curveAt(state.run.judged, t) : null;
      if (judged !== null) text += " " + r.quantity.charAt(0).toUpperCase() + r.quantity.slice(1) + ": " + number(judged, r.unit) + ".";
      layers.forEach(function (each) {
        if (each.layer.say && each.box.checked && each.layer.has(state.run.id)) text += " " + each.layer.say(view());
      });
      if (t >= s.end - 1e-6) text += " End: " + state.run.outcome + ".";
      now.textContent = text;
    }
    function draw() {
      if (!state.series) return;
      if (show.follow) frame();
      if (parts.ghost) place(parts.ghost, state.otherSeries, Math.min(state.t, state.otherSeries.end));
      place(parts.main, state.series, Math.min(state.t, state.series.end));
      placeLeaves(Math.min(state.t, state.series.end));
      drawLayers();
      map.classList.toggle("rp-no-trails", !show.trails);
      updates.forEach(function (each) { each[0](state.t, each[1](state.t)); });
      [laneCursor, filmCursor].forEach(function (cursor) { if (cursor) cursor.place(Math.min(state.t, state.series.end)); });
      slider.value = state.t;
      slider.setAttribute("aria-valuetext", state.t.toFixed(1) + " seconds");
      say();
    }
    function end() { return Math.max(state.series.end, state.otherSeries ? state.otherSeries.end : 0); }
    function goTo(t) { if (!state.series) return; state.t = clamp(t, state.series.t0, end()); draw(); remember(); }
    function tick(stamp) {
      if (!state.playing) return;
      if (lastFrame !== null) state.t = Math.min(end(), state.t + (stamp - lastFrame) / 1000 * state.speed);
      lastFrame = stamp;
      draw();
      if (state.t >= end()) pause(); else root.requestAnimationFrame(tick);
    }
    function play() {
      if (state.playing || !state.series) return;
      if (state.t >= end() - 1e-6) state.t = state.series.t0;
      state.playing = true; lastFrame = null;
      playButton.textContent = "Pause";
      root.requestAnimationFrame(tick);
    }
    function pause() {
      if (!state.playing) return;
      state.playing = false; lastFrame = null;
      playButton.textContent = "Play"; remember();
    }
    function setSpeed(speed) { state.speed = +speed; speedSelect.value = String(speed); }
    let touched = false;
    function remember() {
      if (!options.address || !touched || !state.run) return;
      root.history.replaceState(null, "", "#run=" + encodeURIComponent(state.run.id) + "&t=" + state.t.toFixed(1));
    }

    /* choosing */
    function load(run, group) {
      if (!cache.has(run.id)) cache.set(run.id, decode(run, group, data.period));
      return cache.get(run.id);
    }
    function select(id, t) {
      const group = byRun.get(id);
      if (!group) return Promise.resolve(false);
      const token = ++state.token;
      ready = load(group.runs.find(function (r) { return r.id === id; }), group).then(function (series) {
        if (token !== state.token) return false;
        const changed = group !== state.group;
        state.group = group; state.run = group.runs.find(function (r) { return r.id === id; }); state.series = series;
        if (changed || state.other === state.run) { state.other = null; state.otherSeries = null; }
        state.t = clamp(t === undefined || !isFinite(t) ? state.run.opens : t, series.t0, series.end);
        if (cropped) shownBox = encounter(series, state.t);
        refresh();
        remember();
        return true;
      });
      return ready;
    }
    function compare(id) {
      const run = id ? state.group.runs.find(function (r) { return r.id === id; }) : null;
      if (!run) { state.other = null; state.otherSeries = null; refresh(); return Promise.resolve(); }
      ready = load(run, state.group).then(function (series) { state.other = run; state.otherSeries = series; refresh(); });
      return ready;
    }
    function refresh() {
      groupSelect.value = String(data.groups.indexOf(state.group));
      compareSelect.textContent = "";
      html(compareSelect, "option", { value: "" }, "no other run");
      state.group.runs.forEach(function (run, k) { if (run !== state.run) html(compareSelect, "option", { value: run.id }, "run " + (k + 1) + ": " + title(run)); });
      compareSelect.value = state.other ? state.other.id : "";
      slider.min = state.series.t0; slider.max = end();
      const place0 = state.group.runs.indexOf(state.run) + 1;
      let text = (state.group.purpose === "confirmation" ? "Confirmation run " : state.group.purpose === "search" ? "Search run " : "Run ") + place0 + " of " + state.group.runs.length + ": " + title(state.run) + ". " + state.run.outcome.charAt(0).toUpperCase() + state.run.outcome.slice(1) + ".";
      if (state.otherSeries) {
        const part = parting(state.series, state.otherSeries, state.group.people);
        text += part ? " The two runs part at " + part.t.toFixed(1) + " s (" + part.who + ")." : " The two runs are alike.";
      }
      about.textContent = text;
      const at0 = state.marked.indexOf(state.run.id);
      chosen.style.display = state.marked.length > 1 ? "" : "none";
      chosenText.textContent = state.marked.length + " runs are selected" + (at0 < 0 ? "" : "; this is number " + (at0 + 1)) + ".";
      redrawStrip(); redraw(); redrawLanes(); redrawFilm(); redrawCharts(); frame(); draw();
      element.dispatchEvent(new CustomEvent("replaychange", { detail: api.state() }));
    }
    function fromAddress() {
      const wanted = new URLSearchParams(root.location.hash.slice(1));
      const runs = (wanted.get("runs") || "").split(",").filter(function (id) { return byRun.has(id); });
      const id = wanted.get("run") || runs[0];
      if (!id || !byRun.has(id)) return false;
      pause();
      state.marked = runs;
      select(id, wanted.has("t") ? parseFloat(wanted.get("t")) : undefined);
      return true;
    }

    /* events */
    element.addEventListener("pointerdown", function () { touched = true; }, { capture: true, signal: signal });
    element.addEventListener("keydown", function () { touched = true; }, { capture: true, signal: signal });
    groupSelect.addEventListener("change", function () { touched = true; pause(); state.marked = []; select(data.groups[+groupSelect.value].runs[0].id); });
    compareSelect.addEventListener("change", function () { compare(compareSelect.value); });
    before.addEventListener("click", function () { step(-1); });
    after.addEventListener("click", function () { step(1); });
    clear.addEventListener("click", function () { state.marked = []; refresh(); });
    playButton.addEventListener("click", function () { if (state.playing) pause(); else play(); });
    back.addEventListener("click", function () { goTo(state.t - 1); });
    forth.addEventListener("click", function () { goTo(state.t + 1); });
    slider.addEventListener("input", function () { pause(); goTo(+slider.value); });
    speedSelect.addEventListener("change", function () { setSpeed(speedSelect.value); });
    decisive.addEventListener("click", function () { pause(); goTo(state.run.opens); if (options.stage) { look(encounter(state.series, state.t)); cropped = true; } });
    strip.addEventListener("keydown", function (event) {
      if (event.key === "ArrowRight" || event.key === "ArrowLeft") {
        const dots = Array.from(strip.querySelectorAll(".rp-dot")), k = dots.findIndex(function (d) { return d.getAttribute("aria-checked") === "true"; });
        const next = dots[(k + (event.key === "ArrowRight" ? 1 : dots.length - 1)) % dots.length];
        event.preventDefault(); event.stopPropagation();
        const id = next.dataset.run;
        select(id).then(function () { const dot = Array.from(strip.querySelectorAll(".rp-dot")).find(function (d) { return d.dataset.run === id; }); if (dot) dot.focus(); });
      }
    });
    options.keys.addEventListener("keydown", function (event) {
      const tag = event.target && event.target.tagName;
      if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || !state.series) return;
      if (tag === "SELECT" || tag === "TEXTAREA" || (tag === "INPUT" && event.target !== slider)) return;
      if (event.key === " " && (tag === "BUTTON" || tag === "SUMMARY" || tag === "A")) return;
      const seconds = event.shiftKey ? 1 : 0.1, s = SPEEDS.indexOf(state.speed);
      const keys = {
        " ": function () { if (state.playing) pause(); else play(); },
        ArrowLeft: function () { pause(); goTo(state.t - seconds); },
        ArrowRight: function () { pause(); goTo(state.t + seconds); },
        "[": function () { step(-1); },
        "]": function () { step(1); },
        "+": function () { setSpeed(SPEEDS[Math.min(s + 1, SPEEDS.length - 1)]); },
        "-": function () { setSpeed(SPEEDS[Math.max(s - 1, 0)]); },
        d: function () { pause(); goTo(state.run.opens); },
        f: function () { switches.follow.click(); },
      };
      if (!keys[event.key]) return;
      event.preventDefault(); touched = true; keys[event.key]();
    }, { signal: signal });
    if (root.ResizeObserver) {
      let width = 0;
      const sizes = new root.ResizeObserver(function () {
        if (!state.series || element.clientWidth === width) return;
        width = element.clientWidth;
        redrawStrip(); redrawLanes(); redrawFilm(); redrawCharts(); frame(); draw();
      });
      sizes.observe(element);
      signal.addEventListener("abort", function () { sizes.disconnect(); });
    }
    if (options.address) root.addEventListener("hashchange", function () { if (fromAddress()) (options.stage || element).scrollIntoView({ block: "nearest" }); }, { signal: signal });
    /** Stop, and leave the element as it was, empty. */
    function destroy() { pause(); gone.abort(); element.textContent = ""; if (options.stage) options.stage.textContent = ""; element.classList.remove("rp"); }

    const api = {
      select: select, compare: compare, addLayer: addLayer, redraw: draw, element: element, tools: tools, destroy: destroy, seek: goTo, play: play, pause: pause, setSpeed: setSpeed,
      ready: function () { return ready; },
      runs: function () { return Array.from(byRun.keys()); },
      state: function () { return { marked: state.marked, group: state.group && state.group.id, run: state.run && state.run.id, other: state.other && state.other.id, t: state.t, playing: state.playing, speed: state.speed, end: state.series && end() }; },
    };
    if (!options.stage && (element.clientWidth || 1000) < 560) { show.follow = true; switches.follow.checked = true; }
    if (byRun.has(options.run) && isFinite(options.t)) byRun.get(options.run).runs.find(function (r) { return r.id === options.run; }).opens = options.t;
    if (!(options.address && fromAddress())) select(options.run && byRun.has(options.run) ? options.run : first.runs[0].id, options.t);
    return api;
  }
  root.rvsgReplay = { mount: mount, channels: channels, html: html, svg: svg };
})(window);
