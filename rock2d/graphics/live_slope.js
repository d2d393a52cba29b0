// The live view of a run: shows the numbers that rock2d/design/live_slope.py has computed, and computes none itself.
(async () => {
  const find = (id) => document.getElementById(`live-${id}`), section = document.getElementById("live");
  const { unpacked, starts, columns, every, sorted, numbers, cleared, ticks, row, swatch } = live;
  if (!live.able()) return;
  const data = JSON.parse(find("data").textContent);
  const { stations, limits, blocks, colours, paths } = data;
  const STEP_S = 0.04, LEAST_STEPS = 50, THUMB_PX = 16, NEAR_PX = 12;

  // ---- data -------------------------------------------------------------------------------------------------------
  const first = starts(paths.counts), points = first.at(-1), raw = await unpacked(paths.points);
  const [t, x, y] = columns(raw, paths.scales, paths.steps, points);
  const arc = new Uint8Array(raw, 6 * points, points);
  const impacts = data.impacts, firstImpact = starts(impacts.counts), impactCount = firstImpact.at(-1);
  const impactRaw = await unpacked(impacts.rows);
  const impactColumns = impacts.columns.map((_, i) => new Float32Array(impactRaw, 4 * i * impactCount, impactCount));
  const impactZone = new Uint16Array(impactRaw, 4 * impacts.columns.length * impactCount, impactCount);

  // ---- state, also in the address ---------------------------------------------------------------------------------
  const state = {};
  function readAddress() {
    const said = live.address();
    const at = said.has("x") ? Number(said.get("x")) : null;
    state.station = nearest(Number.isFinite(at) ? at : (limits[0] + limits[1]) / 2);
    state.block = said.has("block") ? numbers(said.get("block"), blocks.length) : every(blocks.length);
    state.stop = said.has("stop") ? numbers(said.get("stop"), paths.stops.length) : every(paths.stops.length);
    state.worst = said.get("worst") === "1";
    state.quantity = Math.min(Math.max(parseInt(said.get("quantity")) || 0, 0), data.curves.length - 1);
    state.path = said.has("release") ? paths.release.indexOf(Number(said.get("release"))) : -1;
    state.time = state.path < 0 ? 0 : t[first[state.path]];
  }
  const writeAddress = () => live.writeAddress(() => ({
    x: +stations[state.station][0].toPrecision(8),
    ...(state.block.size < blocks.length && { block: sorted(state.block).join() }),
    ...(state.stop.size < paths.stops.length && { stop: sorted(state.stop).join() }),
    ...(state.worst && { worst: 1 }),
    ...(state.quantity && { quantity: state.quantity }),
    ...(state.path >= 0 && { release: paths.release[state.path] }),
  }));
  function nearest(at) { // of equally near ones the measure line
    const miss = (s) => Math.abs(s[0] - at) - (s[2] ? 1e-9 : 0);
    return stations.reduce((best, s, i) => (miss(s) < miss(stations[best]) ? i : best), 0);
  }
  const shown = (i) => state.block.has(paths.block[i]) && state.stop.has(paths.stop[i]) && (!state.worst || paths.worst[i]);

  // ---- the section ------------------------------------------------------------------------------------------------
  const stage = find("stage"), [ground, ways, top] = stage.children;
  const view = new live.View(stage, limits);
  const px = (at) => view.x(at), py = (at) => view.y(at);
  function fit() {
    view.fit();
    const wide = (limits[1] - limits[0]) * view.scale;
    slider.style.marginLeft = `${view.left - THUMB_PX / 2}px`;
    slider.style.width = `calc(100% - ${stage.clientWidth - wide - THUMB_PX}px)`;
  }
  function trace(pen, i) {
    const end = first[i + 1] - 1;
    pen.moveTo(px(x[first[i]]), py(y[first[i]]));
    for (let j = first[i]; j < end; j++) {
      const [x1, y1] = [px(x[j + 1]), py(y[j + 1])];
      if (arc[j]) {
        const sag = (paths.gravity * (t[j + 1] - t[j]) ** 2) / 4;
        pen.quadraticCurveTo(px((x[j] + x[j + 1]) / 2), py((y[j] + y[j + 1]) / 2 + sag), x1, y1);
      } else pen.lineTo(x1, y1);
    }
  }
  function drawPaths() {
    ways.hidden = state.path >= 0;
    if (ways.hidden) return;
    const pen = cleared(ways), drawn = paths.release.map((_, i) => i).filter(shown);
    pen.globalAlpha = Math.min(Math.max(100 / drawn.length, 0.1), 0.8);
    for (const i of drawn) {
      pen.strokeStyle = blocks[paths.block[i]].colour;
      pen.beginPath();
      trace(pen, i);
      pen.stroke();
    }
    said(`${drawn.length} of ${paths.release.length} paths shown`);
  }
  function place(i, time) { // of a path at a time
    let j = first[i];
    while (j < first[i + 1] - 2 && t[j + 1] <= time) j++;
    const lasts = t[j + 1] - t[j], share = lasts > 0 ? Math.min(Math.max((time - t[j]) / lasts, 0), 1) : 1;
    const sag = arc[j] ? 0.5 * paths.gravity * lasts ** 2 * share * (1 - share) : 0;
    return [x[j] + share * (x[j + 1] - x[j]), y[j] + share * (y[j + 1] - y[j]) + sag];
  }
  function drawTop() {
    const pen = cleared(top), at = px(stations[state.station][0]);
    pen.strokeStyle = colours.ink;
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(at, view.top);
    pen.lineTo(at, view.bottom);
    pen.stroke();
    if (state.path < 0) return;
    const block = blocks[paths.block[state.path]];
    pen.strokeStyle = pen.fillStyle = block.colour;
    pen.beginPath();
    trace(pen, state.path);
    pen.stroke();
    const [bx, by] = place(state.path, player.time);
    pen.beginPath();
    pen.arc(px(bx), py(by), Math.max(block.radius * view.scale, 5), 0, 2 * Math.PI);
    pen.fill();
  }

  // ---- the collector ----------------------------------------------------------------------------------------------
  const slider = find("station");
  function fillTable() {
    const [at, zone, measured] = stations[state.station];
    const words = `x = ${at.toFixed(view.decimals)} m, ${zone}${measured ? `, measure line: ${measured}` : ""}`;
    find("place").textContent = words;
    slider.value = state.station;
    slider.setAttribute("aria-valuetext", words);
    find("tables").replaceChildren(...sorted(state.block).map((b) => {
      const [passed, frequency, values] = data.texts[b][state.station], table = document.createElement("table");
      table.className = "cells";
      table.createCaption().textContent = `${blocks[b].name}: ${passed} past, ${frequency} of the released`;
      table.caption.prepend(swatch(blocks[b].colour));
      row(table.createTHead(), ["", ...data.percentiles], "th");
      const body = table.createTBody();
      data.quantities.forEach((name, q) => row(body, [name, ...values[q]]));
      return table;
    }));
  }
  const curve = find("curve"), DASHES = [[2, 2], [], [7, 3]];
  const upright = stations.filter((s) => !s[2]);
  function drawCurve() {
    const pen = cleared(curve), height = curve.clientHeight, low = height - 8, high = 24;
    const lines = data.curves[state.quantity].filter((_, b) => state.block.has(b));
    const colour = blocks.filter((_, b) => state.block.has(b)).map((block) => block.colour);
    const most = Math.max(...lines.flat(2).filter((v) => v !== null), 0) || 1;
    const qy = (v) => low - ((low - high) * v) / most;
    pen.fillStyle = colours.ink;
    pen.fillText(data.curve_labels[state.quantity], view.left + 4, high - 12);
    pen.textAlign = "right";
    for (const v of ticks(0, most, 4)) {
      pen.fillText(`${v}`, view.left - 6, qy(v) + 4);
      pen.fillRect(view.left - 4, qy(v), 4, 1);
    }
    pen.fillRect(view.left, low, px(limits[1]) - view.left, 1);
    lines.forEach((own, b) => {
      pen.strokeStyle = pen.fillStyle = colour[b];
      if (state.quantity === 0) {
        pen.globalAlpha = 0.2;
        pen.beginPath();
        upright.forEach((s, i) => pen.lineTo(px(s[0]), qy(own[1][i])));
        upright.toReversed().forEach((s, i) => pen.lineTo(px(s[0]), qy(own[2].at(-1 - i))));
        pen.fill();
        pen.globalAlpha = 1;
      }
      (state.quantity === 0 ? [own[0]] : own).forEach((values, k) => {
        pen.setLineDash(state.quantity === 0 ? [] : DASHES[k]);
        pen.beginPath();
        let on = false;
        values.forEach((v, i) => {
          if (v !== null) on ? pen.lineTo(px(upright[i][0]), qy(v)) : pen.moveTo(px(upright[i][0]), qy(v));
          on = v !== null;
        });
        pen.stroke();
      });
      pen.setLineDash([]);
    });
    pen.fillStyle = colours.ink;
    pen.fillRect(px(stations[state.station][0]) - 1, high, 2, low - high);
    const dashes = ["dotted", "line", "dashed"].map((word, k) => `${word}: ${data.percentiles[k]}`).join(", ");
    find("key").textContent = state.quantity === 0 ? "band: 95 % interval" : dashes;
  }

  // ---- one release ------------------------------------------------------------------------------------------------
  const said = (words) => { find("said").textContent = words; };
  const clock = find("time");
  const step = () => Math.min(STEP_S, (clock.max - clock.min) / LEAST_STEPS);
  const parts = { clock, play: find("play"), back: find("back"), on: find("on"), speed: find("speed") };
  const player = new live.Player(parts, (time, way) => time + way * step(), drawTop);
  const digits = (v) => (Number.isFinite(v) ? `${+v.toPrecision(3)}` : "-");
  function fillRelease() {
    player.pause();
    find("one").hidden = state.path < 0;
    find("release").value = state.path < 0 ? "" : paths.release[state.path];
    if (state.path < 0) return;
    player.range(t[first[state.path]], t[first[state.path + 1] - 1]);
    const release = paths.release[state.path], i = impacts.release.indexOf(release);
    said(`release ${release}, ${blocks[paths.block[state.path]].name}, ${paths.stops[paths.stop[state.path]]}`);
    const own = find("impacts");
    own.tHead.replaceChildren();
    own.tBodies[0].replaceChildren();
    own.caption.textContent = i < 0 ? "Impacts: not on this page" : `Impacts: ${impacts.counts[i]}`;
    if (i < 0) return;
    row(own.tHead, ["zone", ...impacts.columns], "th");
    for (let k = firstImpact[i]; k < firstImpact[i + 1]; k++)
      row(own.tBodies[0], [impacts.zones[impactZone[k]], ...impactColumns.map((column) => digits(column[k]))]);
  }
  function pathNear(mx, my) {
    let best = NEAR_PX, found = -1;
    for (let i = 0; i < paths.release.length; i++) {
      if (!shown(i)) continue;
      for (let j = first[i]; j < first[i + 1] - 1; j++) {
        const pieces = arc[j] ? 6 : 1, drop = arc[j] ? 0.5 * paths.gravity * (t[j + 1] - t[j]) ** 2 : 0;
        let [ax, ay] = [px(x[j]), py(y[j])];
        for (let k = 1; k <= pieces; k++) {
          const s = k / pieces, bx = px(x[j] + s * (x[j + 1] - x[j]));
          const by = py(y[j] + s * (y[j + 1] - y[j]) + drop * s * (1 - s));
          const length = (bx - ax) ** 2 + (by - ay) ** 2;
          const along = length ? Math.min(Math.max(((mx - ax) * (bx - ax) + (my - ay) * (by - ay)) / length, 0), 1) : 0;
          const miss = Math.hypot(ax + along * (bx - ax) - mx, ay + along * (by - ay) - my);
          if (miss < best) [best, found] = [miss, i];
          [ax, ay] = [bx, by];
        }
      }
    }
    return found;
  }

  // ---- controls ---------------------------------------------------------------------------------------------------
  let asked = 0;
  function moveTo(station) {
    state.station = station;
    if (!asked) asked = requestAnimationFrame(() => { asked = 0; fillTable(); drawTop(); drawCurve(); });
    writeAddress();
  }
  function choose(path) {
    state.path = path;
    fillRelease();
    drawPaths();
    if (path >= 0) player.set(t[first[path]]);
    else drawTop();
    writeAddress();
  }
  const boxes = (name) => [...section.querySelectorAll(`input[name=${name}]`)];
  function drawAll() {
    view.decimals = Math.max(0, 2 - Math.floor(Math.log10(limits[1] - limits[0]) - 1));
    fit();
    view.scene(cleared(ground), data);
    drawPaths();
    fillTable();
    drawTop();
    drawCurve();
  }
  function showState() {
    for (const name of ["block", "stop"]) for (const box of boxes(name)) box.checked = state[name].has(Number(box.value));
    find("worst").checked = state.worst;
    find("quantity").value = state.quantity;
    fillRelease();
    drawAll();
    if (state.path >= 0) player.set(state.time);
  }
  const at = (event) => view.at(event);
  stage.addEventListener("pointermove", (event) => moveTo(nearest(limits[0] + (at(event)[0] - view.left) / view.scale)));
  stage.addEventListener("click", (event) => choose(pathNear(...at(event))));
  slider.max = stations.length - 1;
  slider.addEventListener("input", () => moveTo(Number(slider.value)));
  for (const name of ["block", "stop"])
    for (const box of boxes(name))
      box.addEventListener("change", () => {
        state[name][box.checked ? "add" : "delete"](Number(box.value));
        state.path = -1;
        fillRelease();
        drawAll();
        writeAddress();
      });
  boxes("block").forEach((box, b) => box.after(swatch(blocks[b].colour)));
  find("worst").addEventListener("change", (event) => { state.worst = event.target.checked; choose(-1); });
  find("quantity").addEventListener("change", (event) => { state.quantity = Number(event.target.value); drawCurve(); writeAddress(); });
  find("release").addEventListener("change", (event) => {
    const path = event.target.value === "" ? -1 : paths.release.indexOf(Number(event.target.value)), wanted = event.target.value;
    choose(path);
    if (path < 0 && wanted !== "") said(`the page holds no path of release ${wanted}`);
  });
  find("all").addEventListener("click", () => choose(-1));
  window.addEventListener("hashchange", () => { readAddress(); showState(); });
  section.hidden = false;
  readAddress();
  showState();
  live.whenResized(stage, drawAll);
})();
