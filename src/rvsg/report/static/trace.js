/*
 * Traces in the replay: what the robot saw, planned and tried, as layers on the map.
 *
 *   const traces = rvsgReplay.traces(replay, { open: true });
 *   traces.add(textOrObject).then(function (run) { ... });   // rejects with a message for people
 *
 * `replay` is what rvsgReplay.mount returned. A trace is the file that `rvsg replay --trace` writes; rvsg/report/trace_view.py
 * describes it. With `open` a button opens such a file from the disk. Text from a trace is only set with textContent.
 */
(function (root) {
  "use strict";
  const COLOURS = 8, SPAN_S = 0.35;

  async function inflate(blob) {
    const packed = Uint8Array.from(atob(blob), function (c) { return c.charCodeAt(0); });
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }
  async function numbers(blob) { return root.rvsgReplay.channels(await inflate(blob)); }

  async function decode(file) {
    const trace = { run: file.run, t: file.frames, lidars: [], phases: file.phases, nodes: file.nodes };
    for (const lidar of file.lidars) {
      const next = await numbers(lidar.blob), n = trace.t.length;
      const read = { of: lidar, x: next(n, 0.01), y: next(n, 0.01), yaw: next(n, 0.01), ranges: [] };
      for (let k = 0; k < n; k++) read.ranges.push(next(lidar.rays, 0.01));
      trace.lidars.push(read);
    }
    const corner = await numbers(file.local.origins), n = trace.t.length;
    trace.local = { of: file.local, column: corner(n, 1), row: corner(n, 1), cells: await inflate(file.local.blob) };
    trace.global = { of: file.global, patches: [], cells: await inflate(file.global.blob) };
    let begin = 0;
    file.global.patches.forEach(function (p) {
      trace.global.patches.push({ t: p[0], row: p[1], column: p[2], rows: p[3], columns: p[4], begin: begin });
      begin += p[3] * p[4];
    });
    const path = await numbers(file.plans.blob);
    trace.plans = file.plans.plans.map(function (p) { return { t: p[0], x: path(p[1], 0.01), y: path(p[1], 0.01) }; });
    const tried = await numbers(file.tried.blob);
    const critics = file.tried.critics || [], shares = file.tried.shares || [];
    trace.tried = file.tried.asked.map(function (a, k) {
      return { critics: critics, shares: shares[k] || [], t: a[0], best: a[2], x: a[3], y: a[4], yaw: a[5], v: tried(a[1], 0.001), w: tried(a[1], 0.001),
        left: file.tried.sideways ? tried(a[1], 0.001) : null, dx: tried(a[1], 0.01), dy: tried(a[1], 0.01), score: tried(a[1], 0.1) };
    });
    return trace;
  }

  /** The last of the entries, in order of time, that is not later than t; -1 before the first. */
  function latest(entries, t, time) {
    let low = -1, high = entries.length - 1;
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (time(entries[middle]) <= t + 1e-6) low = middle; else high = middle - 1;
    }
    return low;
  }
  function frameAt(trace, t) { return Math.max(0, latest(trace.t, t, function (v) { return v; })); }

  /* ---- drawing ---- */

  function paint(cells, begin, rows, columns) {
    const canvas = document.createElement("canvas");
    canvas.width = columns; canvas.height = rows;
    const context = canvas.getContext("2d"), picture = context.createImageData(columns, rows);
    for (let k = 0; k < rows * columns; k++) {
      const cost = cells[begin + k], at = 4 * k;
      let colour = [0, 0, 0, 0];
      if (cost === 255) colour = [128, 128, 128, 50];
      else if (cost === 254) colour = [150, 0, 140, 215];
      else if (cost === 253) colour = [0, 150, 160, 170];
      else if (cost > 0) colour = [Math.round(70 + 185 * cost / 252), 60, Math.round(255 - 215 * cost / 252), 40 + Math.round(90 * cost / 252)];
      picture.data.set(colour, at);
    }
    context.putImageData(picture, 0, 0);
    return canvas.toDataURL();
  }
  function image(group, view, source, x, y, width, height) {
    let node = group.firstChild;
    if (!node) node = view.node(group, "image", { preserveAspectRatio: "none" });
    if (node.getAttribute("href") !== source) node.setAttribute("href", source);
    node.setAttribute("width", width); node.setAttribute("height", height);
    node.setAttribute("transform", view.matrix(x, y));
  }
  /** A path in world metres under the transform of the plan. */
  function line(group, view, kind, text, attributes) {
    return view.node(group, "path", Object.assign({ class: kind, d: text || "M0 0", transform: view.matrix(0, 0) }, attributes || {}));
  }
  /** The arc of a sample: it leaves the robot in the direction of its speed, forwards or to the side. */
  function arc(tried, k) {
    const towards = tried.yaw + (tried.left && tried.left[k] ? Math.atan2(tried.left[k], tried.v[k]) : 0);
    const u = Math.cos(towards) * tried.dx[k] + Math.sin(towards) * tried.dy[k];
    const w = -Math.sin(towards) * tried.dx[k] + Math.cos(towards) * tried.dy[k];
    const end = (tried.x + tried.dx[k]).toFixed(2) + " " + (tried.y + tried.dy[k]).toFixed(2);
    const start = "M" + tried.x.toFixed(2) + " " + tried.y.toFixed(2);
    if (Math.abs(w) < 0.01) return start + "L" + end;
    const radius = Math.abs((u * u + w * w) / (2 * w)).toFixed(2);
    return start + "A" + radius + " " + radius + " 0 " + (u < 0 ? 1 : 0) + " " + (w > 0 ? 1 : 0) + " " + end;
  }

  /** What each critic adds to the score of the chosen trajectory; critics that add nothing are left out. */
  function parts(tried) {
    const said = tried.shares.map(function (share, k) { return [tried.critics[k], share]; })
      .filter(function (each) { return each[1] >= 0.05; })
      .map(function (each) { return each[0] + " " + each[1].toFixed(1); });
    return said.length ? " (" + said.join(", ") + ")" : "";
  }

  const LAYERS = [
    { id: "global-costmap", label: "Global costmap", shown: false, key: function (trace, t) { return latest(trace.global.patches, t, function (p) { return p.t; }); },
      draw: function (group, view, trace, last) {
        const whole = trace.global.patches[0], of = trace.global.of;
        if (last < 0 || !whole) { group.textContent = ""; return; }
        const cells = trace.global.cells.slice(0, whole.rows * whole.columns);
        trace.global.patches.slice(1, last + 1).forEach(function (p) {
          for (let r = 0; r < p.rows; r++) cells.set(trace.global.cells.subarray(p.begin + r * p.columns, p.begin + (r + 1) * p.columns), (p.row + r) * whole.columns + p.column);
        });
        image(group, view, paint(cells, 0, whole.rows, whole.columns), of.x, of.y, whole.columns * of.resolution, whole.rows * of.resolution);
      } },
    { id: "local-costmap", label: "Local costmap", shown: true, key: frameAt,
      draw: function (group, view, trace, k) {
        const of = trace.local.of, size = of.rows * of.columns;
        const source = paint(trace.local.cells, k * size, of.rows, of.columns);
        image(group, view, source, trace.local.column[k] * of.resolution, trace.local.row[k] * of.resolution, of.columns * of.resolution, of.rows * of.resolution);
      } },
    { id: "plan", label: "Plan", shown: true, key: function (trace, t) { return latest(trace.plans, t, function (p) { return p.t; }); },
      draw: function (group, view, trace, k) {
        group.textContent = "";
        if (k < 0) return;
        let text = "";
        trace.plans[k].x.forEach(function (x, i) { text += (i ? "L" : "M") + x.toFixed(2) + " " + trace.plans[k].y[i].toFixed(2); });
        line(group, view, "rp-plan", text);
      } },
    { id: "tried", label: "Local trajectories", shown: true, key: function (trace, t) { return latest(trace.tried, t, function (a) { return a.t; }); },
      draw: function (group, view, trace, k, t) {
        group.textContent = "";
        const tried = trace.tried[k];
        if (!tried || t - tried.t > SPAN_S) return;
        const allowed = Array.from(tried.score).filter(function (s) { return s >= 0; });
        const low = Math.min.apply(null, allowed), span = Math.max.apply(null, allowed) - low || 1;
        const texts = Array(COLOURS).fill("");
        let forbidden = "";
        tried.score.forEach(function (score, i) {
          if (score < 0) forbidden += arc(tried, i);
          else texts[Math.min(COLOURS - 1, Math.floor((score - low) / span * COLOURS))] += arc(tried, i);
        });
        line(group, view, "rp-forbidden", forbidden);
        texts.map(function (text, i) { return [text, i]; }).reverse().forEach(function (each) {
          if (each[0]) line(group, view, "rp-tried", each[0], { stroke: "hsl(" + Math.round(130 - 130 * each[1] / (COLOURS - 1)) + " 75% 42%)" });
        });
        if (tried.best >= 0) line(group, view, "rp-best", arc(tried, tried.best));
      },
      say: function (trace, k, t) {
        const tried = trace.tried[k];
        if (!tried || t - tried.t > SPAN_S) return "The local planner is not asked.";
        if (tried.best < 0) return "The local planner finds no free trajectory.";
        const left = tried.left ? tried.left[tried.best] : 0;
        const aside = left ? ", " + Math.abs(left).toFixed(2) + " m/s to the " + (left > 0 ? "left" : "right") : "";
        return "Local planner: " + tried.v[tried.best].toFixed(2) + " m/s" + aside + ", " + tried.w[tried.best].toFixed(2) + " rad/s, score " + tried.score[tried.best].toFixed(1) + parts(tried) + ".";
      } },
    { id: "lidar", label: "Lidar", shown: true, key: frameAt,
      draw: function (group, view, trace, k) {
        group.textContent = "";
        trace.lidars.forEach(function (lidar) {
          const x = lidar.x[k], y = lidar.y[k], yaw = lidar.yaw[k];
          const ox = x + Math.cos(yaw) * lidar.of.x - Math.sin(yaw) * lidar.of.y, oy = y + Math.sin(yaw) * lidar.of.x + Math.cos(yaw) * lidar.of.y;
          let text = "";
          lidar.ranges[k].forEach(function (range, i) {
            if (range <= 0) return;
            const bearing = yaw + lidar.of.first + i * lidar.of.step;
            text += "M" + (ox + range * Math.cos(bearing)).toFixed(2) + " " + (oy + range * Math.sin(bearing)).toFixed(2) + "h0";
          });
          line(group, view, "rp-hits", text);
        });
      } },
    { id: "tree", label: "Behaviour tree", shown: true, key: function (trace, t) { return latest(trace.nodes, t, function (n) { return n[0]; }); },
      draw: function (group, view, trace) {
        group.textContent = "";
        trace.nodes.forEach(function (n) {
          if (!["ClearingActions", "Spin", "Wait", "BackUp"].includes(n[1]) || n[2] === "RUNNING" && n[3] !== "SUCCESS") return;
          if (n[1] !== "ClearingActions" && n[3] !== "RUNNING") return;
          const k = frameAt(trace, n[0]), p = view.point(trace.lidars[0].x[k], trace.lidars[0].y[k]);
          const pin = view.node(group, "circle", { class: "rp-recovered", cx: p[0], cy: p[1], r: 0.12 });
          view.node(pin, "title", {}, n[0].toFixed(1) + " s: " + n[1]);
        });
      },
      say: function (trace, k, t) {
        const phase = trace.phases[latest(trace.phases, t, function (p) { return p[0]; })], node = trace.nodes[k];
        const said = phase ? "Behaviour tree: " + phase[1] + "." : "";
        return node ? said + " Last: " + node[1] + " " + node[3] + " at " + node[0].toFixed(1) + " s." : said;
      } },
  ];

  function attach(replay, options) {
    const files = new Map(), read = new Map();
    LAYERS.forEach(function (layer) {
      let drawn = null;
      const of = function (view) { return read.get(view.run); };
      const added = { id: layer.id, label: layer.label, shown: layer.shown, has: function (run) { return read.has(run); },
        draw: function (group, view) {
          const trace = of(view), key = layer.key(trace, view.t), old = layer.id === "tried" && trace.tried[key] && view.t - trace.tried[key].t > SPAN_S;
          const state = [view.run, key, old].join();
          if (state === drawn) return;
          drawn = state;
          layer.draw(group, view, trace, key, view.t);
        } };
      if (layer.say) added.say = function (view) { return layer.say(of(view), layer.key(of(view), view.t), view.t); };
      replay.addLayer(added);
    });
    async function show(run) {
      if (read.has(run) || !files.has(run)) return;
      read.set(run, await decode(files.get(run)));
      replay.redraw();
    }
    async function add(given) {
      let file;
      try { file = typeof given === "string" ? JSON.parse(given) : given; } catch (error) { throw new Error("This file is no trace: it is not JSON."); }
      if (!file || file.format !== "rvsg-trace") throw new Error("This file is no trace. rvsg replay --trace writes one.");
      if (file.version !== 1) throw new Error("This trace has version " + file.version + "; this page reads version 1. Write page and trace with the same version of RVSG.");
      if (!replay.runs().includes(file.run)) throw new Error("This trace is of the run " + file.run + ", which is not on this page.");
      files.set(file.run, file); read.delete(file.run);
      if (replay.state().run === file.run) await show(file.run);
      return file.run;
    }
    replay.element.addEventListener("replaychange", function (event) { show(event.detail.run); });
    if (options && options.open) {
      const label = document.createElement("label"), input = document.createElement("input"), note = document.createElement("span");
      label.className = "rp-open"; label.textContent = "Open a trace (rvsg replay --trace makes one) ";
      input.type = "file"; input.accept = ".json"; note.setAttribute("role", "status"); note.className = "rp-note";
      label.appendChild(input);
      input.addEventListener("change", function () {
        if (!input.files.length) return;
        input.files[0].text().then(add).then(function (run) { note.textContent = ""; return replay.select(run, replay.state().run === run ? replay.state().t : undefined); })
          .catch(function (error) { note.textContent = error.message; });
        input.value = "";
      });
      replay.tools.appendChild(label); replay.tools.appendChild(note);
    }
    return { add: add, runs: function () { return Array.from(files.keys()); }, ready: function () { return Promise.all(Array.from(files.keys(), function (run) { return run === replay.state().run ? show(run) : null; })); } };
  }
  root.rvsgReplay.traces = attach;
})(window);
