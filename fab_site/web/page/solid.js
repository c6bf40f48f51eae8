// SPDX-License-Identifier: GPL-3.0-or-later
// The part and its supports in 3-D, built from the layers the page can show anyway. Needs /three.js (libjs-three);
// loaded on the first look, so that the page itself stays small.
"use strict";

(() => {
  const box = byId("solid-box"), canvas = byId("solid"), note = byId("solid-note");
  const mostLayers = 150;
  let view = null, shown = null;

  function loadLibrary() {
    if (window.THREE) return Promise.resolve();
    return new Promise((done, fail) => {
      const script = document.createElement("script");
      script.src = "/three.js";
      script.onload = done;
      script.onerror = () => fail(new Error("the 3-D view needs the package libjs-three on the fab machine"));
      document.head.append(script);
    });
  }

  // Walls of a ring from z0 to z1, appended as triangles; flat shading needs no shared vertices.
  function addWalls(out, ring, z0, z1) {
    for (let i = 0; i < ring.length; i++) {
      const a = ring[i], b = ring[(i + 1) % ring.length];
      out.push(a[0], a[1], z0, b[0], b[1], z0, b[0], b[1], z1, a[0], a[1], z0, b[0], b[1], z1, a[0], a[1], z1);
    }
  }

  function area(ring) {
    let twice = 0;
    for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) twice += ring[j][0] * ring[i][1] - ring[i][0] * ring[j][1];
    return twice / 2;
  }

  function inside(ring, p) {
    let is = false;
    for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
      const a = ring[i], b = ring[j];
      if (a[1] > p[1] !== b[1] > p[1] && p[0] < a[0] + ((p[1] - a[1]) / (b[1] - a[1])) * (b[0] - a[0])) is = !is;
    }
    return is;
  }

  // Top faces, each outer ring with the holes that lie in it.
  function addTops(out, rings, z) {
    const flat = (r) => r.map((p) => new THREE.Vector2(p[0], p[1]));
    for (const outer of rings.filter((r) => area(r) > 0)) {
      const holes = rings.filter((r) => area(r) < 0 && inside(outer, r[0]));
      const all = [outer, ...holes].flat();
      for (const face of THREE.ShapeUtils.triangulateShape(flat(outer), holes.map(flat))) for (const i of face) out.push(all[i][0], all[i][1], z);
    }
  }

  function thin(ring) {
    const kept = ring.filter((p, i) => i === 0 || i % Math.max(1, Math.floor(ring.length / 160)) === 0);
    return kept.length > 2 ? kept : ring;
  }

  async function build(job) {
    const step = Math.max(1, Math.ceil(job.layers / mostLayers));
    const part = [], supports = [];
    let bounds = null, top = 0;
    for (let n = 0; n < job.layers; n += step) {
      const layer = await get(`/v1/jobs/${job.id}/layers/${n}`);
      if (shown !== job.id) return null;
      bounds = layer.bounds;
      const z0 = layer.z_mm - layer.thickness_mm / 2, z1 = z0 + step * layer.thickness_mm;
      top = z1;
      for (const [out, rings] of [[part, layer.part], [supports, layer.supports]]) {
        const thinned = rings.map((r) => thin(r));
        for (const ring of thinned) addWalls(out, ring, z0, z1);
        addTops(out, thinned, z1);
      }
      if (n % (10 * step) === 0) note.textContent = `layer ${n} of ${job.layers}`;
    }
    return { part, supports, bounds, top };
  }

  function mesh(points, colour) {
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    shape.computeVertexNormals();
    return new THREE.Mesh(shape, new THREE.MeshLambertMaterial({ color: colour, side: THREE.DoubleSide, flatShading: true }));
  }

  function show(solid) {
    const scene = new THREE.Scene();
    const style = getComputedStyle(document.documentElement);
    scene.background = new THREE.Color(style.getPropertyValue("--paper").trim());
    const group = new THREE.Group();
    group.add(mesh(solid.part, style.getPropertyValue("--part").trim()), mesh(solid.supports, style.getPropertyValue("--support").trim()));
    const [x0, y0, x1, y1] = solid.bounds;
    group.position.set(-(x0 + x1) / 2, -(y0 + y1) / 2, -solid.top / 2);
    const turn = new THREE.Group();
    turn.add(group);
    scene.add(turn, new THREE.AmbientLight(0xffffff, 0.45));
    const lamp = new THREE.DirectionalLight(0xffffff, 0.8);
    lamp.position.set(1, -2, 2);
    scene.add(lamp);
    const size = Math.max(x1 - x0, y1 - y0, solid.top);
    const camera = new THREE.PerspectiveCamera(30, canvas.width / canvas.height, size / 100, size * 20);
    camera.up.set(0, 0, 1);
    const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    renderer.setSize(canvas.width, canvas.height, false);
    const pose = { azimuth: -0.7, height: 0.35, distance: size * 2.6 };
    const draw = () => {
      const c = Math.cos(pose.height);
      camera.position.set(pose.distance * c * Math.cos(pose.azimuth), pose.distance * c * Math.sin(pose.azimuth), pose.distance * Math.sin(pose.height));
      camera.lookAt(0, 0, 0);
      renderer.render(scene, camera);
    };
    view = { pose, draw, size };
    draw();
  }

  function turnBy(azimuth, height, zoom = 1) {
    if (!view) return;
    view.pose.azimuth += azimuth;
    view.pose.height = Math.max(-1.5, Math.min(1.5, view.pose.height + height));
    view.pose.distance = Math.max(view.size, Math.min(view.size * 10, view.pose.distance * zoom));
    view.draw();
  }
  canvas.onpointerdown = (e) => canvas.setPointerCapture(e.pointerId);
  canvas.onpointermove = (e) => e.buttons && turnBy(-e.movementX / 150, e.movementY / 150);
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); turnBy(0, 0, Math.exp(e.deltaY / 800)); }, { passive: false });
  const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1], "+": [0, 0, 0.9], "-": [0, 0, 1.1] };
  canvas.onkeydown = (e) => {
    if (!keys[e.key]) return;
    e.preventDefault();
    turnBy(...keys[e.key]);
  };

  async function open() {
    const job = state.jobs.find((j) => j.id === state.chosen);
    if (!box.open || !job || shown === job.id) return;
    if (!job.layers) {
      note.textContent = "not planned yet";
      return;
    }
    shown = job.id;
    try {
      await loadLibrary();
      const solid = await build(job);
      if (!solid) return;
      show(solid);
      note.textContent = "drag or use the arrow keys to turn, the wheel or + and - to come nearer";
    } catch (error) {
      shown = null;
      note.textContent = error.message;
    }
  }
  box.ontoggle = open;
  document.addEventListener("job-chosen", open);
})();
