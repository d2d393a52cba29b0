"use strict";
// Common parts of the live views of pages. They unpack, draw and play what Python has computed.
const live = (() => {
  const MOST_HIGH_PX = 440, MARGIN = { left: 46, right: 10, top: 8, bottom: 24 }, ADDRESS_MS = 250;

  // ---- data -------------------------------------------------------------------------------------------------------
  const able = () => window.DecompressionStream && CanvasRenderingContext2D.prototype.reset; // else: the page without a script
  async function unpacked(text) { // what `packed` of Python made
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).arrayBuffer();
  }
  const starts = (counts) => counts.reduce((sums, n) => (sums.push(sums.at(-1) + n), sums), [0]);
  function columns(raw, scales, steps, rows) { // what `packed_columns` of Python made: [least, span] of each column
    return scales.map(([least, span], column) => {
      const [high, low] = [0, 1].map((part) => new Uint8Array(raw, (2 * column + part) * rows, rows));
      let sum = 0;
      return Float64Array.from(high, (step, i) => least + (span * (sum = (sum + 256 * step + low[i]) & 0xffff)) / steps);
    });
  }

  const fixed = (value, digits) => (+value.toFixed(digits) + 0).toFixed(digits); // no minus before a zero

  // ---- state in the address ---------------------------------------------------------------------------------------
  const address = () => new URLSearchParams(location.hash.slice(1));
  let writing = 0, shown = location.hash;
  function writeAddress(fields) { // browsers slow down pages that do this at every move
    clearTimeout(writing);
    writing = setTimeout(() => {
      if (location.hash !== shown) return; // the reader asked for another address, which is not read yet
      history.replaceState(null, "", `#${decodeURIComponent(new URLSearchParams(fields()))}`);
      shown = location.hash;
    }, ADDRESS_MS);
  }
  window.addEventListener("hashchange", () => { shown = location.hash; });
  const every = (n) => new Set(Array(n).keys());
  const sorted = (set) => [...set].sort((a, b) => a - b);
  const whole = (text, n) => (/^\d+$/.test(text ?? "") && +text < n ? +text : ""); // one of the numbers from 0 to n - 1
  const numbers = (text, n) => new Set(text.split(",").filter((i) => i !== "" && +i >= 0 && +i < n).map(Number));

  // ---- drawing ----------------------------------------------------------------------------------------------------
  function cleared(canvas) {
    const dense = window.devicePixelRatio || 1, pen = canvas.getContext("2d");
    const [width, height] = [canvas.clientWidth * dense, canvas.clientHeight * dense].map(Math.round);
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    pen.reset();
    pen.scale(dense, dense);
    pen.font = "12px system-ui, sans-serif";
    pen.lineJoin = "round";
    return pen;
  }
  function ticks(low, high, most) {
    const rough = (high - low) / most, ten = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((m) => m * ten).find((s) => s >= rough);
    const found = [];
    for (let i = Math.ceil(low / step); i * step <= high; i++) found.push(+(i * step).toPrecision(10));
    return found;
  }
  class View { // a part of the cross-section on a stage of canvases; limits: left, right, low, high in m
    constructor(stage, limits) { Object.assign(this, { stage, limits }); }
    fit(limits = this.limits) { // the stage becomes as high as they need
      this.limits = limits;
      const wide = limits[1] - limits[0], high = limits[3] - limits[2];
      const room = this.stage.clientWidth - MARGIN.left - MARGIN.right;
      this.scale = Math.min(room / wide, MOST_HIGH_PX / high);
      this.left = MARGIN.left + (room - wide * this.scale) / 2;
      this.top = MARGIN.top;
      this.bottom = MARGIN.top + high * this.scale;
      this.stage.style.height = `${this.bottom + MARGIN.bottom}px`;
    }
    x(at) { return this.left + (at - this.limits[0]) * this.scale; }
    y(at) { return this.top + (this.limits[3] - at) * this.scale; }
    line(pen, list) {
      pen.beginPath();
      list.forEach(([a, b], i) => (i ? pen.lineTo(this.x(a), this.y(b)) : pen.moveTo(this.x(a), this.y(b))));
    }
    clip(pen) {
      const left = this.x(this.limits[0]);
      pen.beginPath();
      pen.rect(left, this.top, this.x(this.limits[1]) - left, this.bottom - this.top);
      pen.clip();
    }
    at(event) {
      const box = this.stage.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    }
    scene(pen, scene) { // the ground with its zones, measure lines, and the scales
      const { limits, bottom, left } = this, { ground, colours } = scene, right = this.x(limits[1]);
      const floor = limits[2] - 1e3 * (limits[3] - limits[2]);
      pen.save();
      this.clip(pen);
      pen.fillStyle = colours.sky;
      pen.fill();
      this.line(pen, [...ground, [ground.at(-1)[0], floor], [ground[0][0], floor]]);
      pen.fillStyle = colours.deep;
      pen.fill();
      pen.save();
      pen.clip(); // the zones tint the ground below the surface alone
      pen.lineWidth = 28;
      pen.lineCap = "round";
      scene.tones.forEach((tone, i) => {
        pen.strokeStyle = tone;
        this.line(pen, ground.slice(i, i + 2));
        pen.stroke();
      });
      pen.restore();
      pen.strokeStyle = colours.ink;
      pen.lineWidth = 1.5;
      this.line(pen, ground);
      pen.stroke();
      pen.strokeStyle = colours.line;
      pen.setLineDash([5, 3]);
      for (const ends of scene.lines) this.line(pen, ends), pen.stroke();
      pen.restore();
      pen.fillStyle = colours.ink;
      pen.textAlign = "center";
      for (const at of ticks(limits[0], limits[1], this.stage.clientWidth / 90))
        if (this.x(at) < right - 45) pen.fillText(`${at}`, this.x(at), bottom + 15);
      pen.textAlign = "right";
      for (const at of ticks(limits[2], limits[3], (bottom - this.top) / 60))
        if (this.y(at) > this.top + 20) pen.fillText(`${at}`, left - 6, this.y(at) + 4);
      pen.fillText("x (m)", right, bottom + 15);
      pen.fillText("y (m)", left - 6, this.top + 9);
    }
  }
  function whenResized(stage, draw) { // in width; the height follows from it
    let wide = stage.clientWidth;
    new ResizeObserver(() => { if (stage.clientWidth !== wide) { wide = stage.clientWidth; draw(); } }).observe(stage);
  }

  // ---- tables and playing -----------------------------------------------------------------------------------------
  function row(parent, cells, tag = "td") {
    const made = parent.insertRow();
    for (const text of cells) made.appendChild(document.createElement(tag)).textContent = text;
    return made;
  }
  function swatch(colour) {
    const mark = document.createElement("i");
    mark.style.background = colour;
    return mark;
  }
  class Player { // a clock in s with its controls; next(time, way): a step on or back; changed(time): shows it
    constructor({ clock, play, back, on, speed }, next, changed) {
      Object.assign(this, { clock, button: play, speed, changed, playing: 0, time: 0 });
      play.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
      for (const [button, way] of [[back, -1], [on, 1]])
        button.addEventListener("click", () => { this.pause(); this.set(next(this.time, way)); });
      clock.addEventListener("input", () => { const time = Number(clock.value); this.pause(); this.set(time); });
    }
    range(first, last) { this.pause(); [this.clock.min, this.clock.max] = [first, last]; }
    set(time) {
      this.time = Math.min(Math.max(time, Number(this.clock.min)), Number(this.clock.max));
      this.clock.value = this.time;
      this.clock.setAttribute("aria-valuetext", `${fixed(this.time, 2)} s`);
      this.changed(this.time);
    }
    pause() {
      cancelAnimationFrame(this.playing);
      this.playing = 0;
      this.button.textContent = "play";
    }
    play() {
      this.button.textContent = "pause";
      if (this.time >= Number(this.clock.max)) this.set(Number(this.clock.min));
      let before = performance.now();
      const frame = (now) => {
        this.set(this.time + ((now - before) / 1000) * Number(this.speed.value));
        before = now;
        if (this.time < Number(this.clock.max)) this.playing = requestAnimationFrame(frame);
        else this.pause();
      };
      this.playing = requestAnimationFrame(frame);
    }
  }
  return { able, unpacked, starts, columns, fixed, address, writeAddress, every, sorted, whole, numbers, cleared, ticks, View, whenResized, row, swatch, Player };
})();
