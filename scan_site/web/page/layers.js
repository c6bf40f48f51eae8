// SPDX-License-Identifier: GPL-3.0-or-later
// Contours of a job's layers, as they are cut: measured, completed and doubtful stretches in their colours.
"use strict";

const cutLayers = (() => {
  const slider = byId("cut-layer"), canvas = byId("cut");
  const self = { key: "", drawnAt: 0, drawn: "" };
  const addressOf = (id, n) => `/v1/jobs/${id}/layers/${n}`;

  function draw(layer) {
    const pen = canvas.getContext("2d"), style = getComputedStyle(document.documentElement);
    const [x0, y0, x1, y1] = layer.bounds;
    pen.clearRect(0, 0, canvas.width, canvas.height);
    const scale = Math.min(canvas.width / (x1 - x0), canvas.height / (y1 - y0)) * 0.94;
    const x = (p) => canvas.width / 2 + (p[0] - (x0 + x1) / 2) * scale, y = (p) => canvas.height / 2 - (p[1] - (y0 + y1) / 2) * scale;
    pen.beginPath();
    for (const ring of layer.rings) {
      ring.forEach((p, i) => (i ? pen.lineTo(x(p), y(p)) : pen.moveTo(x(p), y(p))));
      pen.closePath();
    }
    pen.globalAlpha = 0.15;
    pen.fillStyle = style.getPropertyValue("--measured");
    pen.fill("nonzero");
    pen.globalAlpha = 1;
    const widths = { measured: 1.5, completed: 3.5, doubtful: 3.5 };
    layer.rings.forEach((ring, r) => {
      let at = 0;
      for (const [kind, edges] of layer.kinds[r]) {
        pen.beginPath();
        pen.moveTo(x(ring[at % ring.length]), y(ring[at % ring.length]));
        for (let e = 1; e <= edges; e++) pen.lineTo(x(ring[(at + e) % ring.length]), y(ring[(at + e) % ring.length]));
        at += edges;
        pen.lineWidth = widths[kind];
        pen.strokeStyle = style.getPropertyValue(`--${kind}`);
        pen.stroke();
      }
    });
    // A scale bar of a round length, at most a quarter of the picture.
    const most = canvas.width / 4 / scale, ten = 10 ** Math.floor(Math.log10(most)), bar = ten * [5, 2, 1].find((f) => f * ten <= most);
    pen.fillStyle = pen.strokeStyle = style.getPropertyValue("--ink");
    pen.fillRect(20, canvas.height - 24, bar * scale, 3);
    pen.font = "20px system-ui, sans-serif";
    pen.fillText(`${bar} mm`, 20, canvas.height - 32);
  }

  async function show() {
    const id = state.chosen, n = Number(slider.value), key = `${id}/${n}`;
    byId("cut-layer-number").textContent = `${n + 1} of ${Number(slider.max) + 1}`;
    if (self.key === key) return;
    self.key = key;
    try {
      const layer = await held.get(addressOf(id, n));
      if (self.key !== key) return;  // the slider has moved on
      draw(layer);
      self.drawn = key;
      self.drawnAt = performance.now();
      held.ahead([n + 1, n - 1, n + 2, n - 2].filter((m) => m >= 0 && m <= Number(slider.max)).map((m) => addressOf(id, m)));
      byId("cut-text").textContent = `layer ${n} at ${layer.z_mm.toFixed(3)} mm, ${layer.rings.length} ring${layer.rings.length === 1 ? "" : "s"}, ${layer.certified ? "certified" : "not certified"}`;
    } catch (error) {
      if (self.key === key) self.key = "";
      byId("cut-text").textContent = error.message;
    }
  }

  slider.oninput = () => {
    byId("cut-follow").checked = false;
    show();
  };
  byId("cut-follow").onchange = () => self.update(chosenJob());
  self.update = (job) => {
    if (!job) return;
    const cut = job.layers_sliced;
    byId("layers-box").hidden = !cut;
    if (!cut) return;
    slider.max = cut - 1;
    // The newest while it is cut; then the middle, where there is most to be seen.
    if (byId("cut-follow").checked) slider.value = job.state === "slicing" ? cut - 1 : Math.floor(cut / 2);
    show();
  };
  self.clear = () => {
    self.key = "";
    byId("cut-follow").checked = true;
    canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
  };
  return self;
})();
