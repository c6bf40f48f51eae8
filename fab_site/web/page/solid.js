// SPDX-License-Identifier: GPL-3.0-or-later
// The print in 3-D on its plate, cut at the layer that is shown, built from the layers the page can show anyway. Needs
// /three.js (libjs-three); loaded when somebody asks for it, so that the page itself stays small. Until then there is
// the picture of the plan.
"use strict";

(() => {
  const canvas = byId("solid"), picture = byId("view"), turn = byId("turn"), note = byId("solid-note");
  const mostLayers = 150;
  let view = null;   // what is shown: of which job and plan, its pose, draw()
  let asked = null;  // the job whose solid is on its way

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
    let last = null, top = 0;
    for (let n = 0; n < job.layers; n += step) {
      const layer = await get(`/v1/jobs/${job.id}/layers/${n}`);
      if (asked !== job.id) return null;
      last = layer;
      const z0 = layer.z_mm - layer.thickness_mm / 2, z1 = z0 + step * layer.thickness_mm;
      top = z1;
      for (const [out, rings] of [[part, layer.part], [supports, layer.supports]]) {
        const thinned = rings.map((r) => thin(r));
        for (const ring of thinned) addWalls(out, ring, z0, z1);
        addTops(out, thinned, z1);
      }
      if (n % (10 * step) === 0) note.textContent = `layer ${n} of ${job.layers}`;
    }
    return { part, supports, bounds: last.bounds, platform: last.platform_mm, top };
  }

  function shapeOf(points) {
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    shape.computeVertexNormals();
    return shape;
  }

  function mesh(points, colour, planes) {
    return new THREE.Mesh(shapeOf(points), new THREE.MeshLambertMaterial({ color: colour, side: THREE.DoubleSide, flatShading: true, clippingPlanes: planes }));
  }

  // The plate as far as the print needs it, with a line each ten millimetres and its own edge where that is in sight.
  function plateOf({ bounds, platform }, colour) {
    const [x0, y0, x1, y1] = bounds, room = 15, lines = [];
    const low = (v) => Math.floor((v - room) / 10) * 10, high = (v) => Math.ceil((v + room) / 10) * 10;
    const [w, d] = platform || [Infinity, Infinity];
    const [l, r, f, b] = [Math.max(low(x0), 0), Math.min(high(x1), w), Math.max(low(y0), 0), Math.min(high(y1), d)];
    const steps = (from, to) => [from, to, ...Array.from({ length: Math.max(0, Math.ceil(to / 10) - Math.ceil(from / 10)) }, (_, i) => (Math.ceil(from / 10) + i) * 10)];
    for (const x of steps(l, r)) lines.push(x, f, 0, x, b, 0);
    for (const y of steps(f, b)) lines.push(l, y, 0, r, y, 0);
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(new Float32Array(lines), 3));
    return new THREE.LineSegments(shape, new THREE.LineBasicMaterial({ color: colour }));
  }

  function show(job, solid) {
    const style = getComputedStyle(document.documentElement), colour = (name) => style.getPropertyValue(name).trim();
    const scene = new THREE.Scene();
    scene.background = new THREE.Color(colour("--paper"));
    const [x0, y0, x1, y1] = solid.bounds, middle = new THREE.Vector3((x0 + x1) / 2, (y0 + y1) / 2, solid.top / 2);
    const group = new THREE.Group(), cut = new THREE.Plane(new THREE.Vector3(0, 0, -1), 1e9), caps = new THREE.Group(), marks = new THREE.Group();
    group.add(mesh(solid.part, colour("--part"), [cut]), mesh(solid.supports, colour("--support"), [cut]), plateOf(solid, colour("--quiet")), caps, marks);
    group.position.copy(middle).negate();
    scene.add(group, new THREE.AmbientLight(0xffffff, 0.45));
    const lamp = new THREE.DirectionalLight(0xffffff, 0.8);
    lamp.position.set(1, -2, 2);
    scene.add(lamp);
    const size = Math.max(x1 - x0, y1 - y0, solid.top);
    const camera = new THREE.PerspectiveCamera(30, canvas.width / canvas.height, size / 100, size * 20);
    camera.up.set(0, 0, 1);
    const renderer = view?.renderer || new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    renderer.localClippingEnabled = true;
    renderer.setSize(canvas.width, canvas.height, false);
    const pose = { azimuth: -1.13, height: 0.52, distance: size * 3.1 };
    const draw = () => {
      const c = Math.cos(pose.height);
      camera.position.set(pose.distance * c * Math.cos(pose.azimuth), pose.distance * c * Math.sin(pose.azimuth), pose.distance * Math.sin(pose.height));
      camera.lookAt(0, 0, 0);
      renderer.render(scene, camera);
    };
    // What lies above the layer is taken off, and the layer itself closes the cut.
    const cutAt = (layer) => {
      const z = layer.z_mm + layer.thickness_mm / 2;
      cut.constant = z - middle.z;
      for (const cap of caps.children) cap.geometry.dispose();
      caps.remove(...caps.children);
      for (const [rings, name] of [[layer.part, "--part"], [layer.supports, "--support"]]) {
        const faces = [];
        addTops(faces, rings.map((r) => thin(r)), z);
        if (faces.length) caps.add(mesh(faces, new THREE.Color(colour(name)).lerp(new THREE.Color("#ffffff"), 0.35), []));
      }
      draw();
    };
    // Places to look at shine through what hides them.
    const mark = () => {
      marks.remove(...marks.children);
      const ball = new THREE.SphereGeometry(size / 90, 12, 8);
      state.issues.slice(0, 300).forEach((issue, i) => {
        const dot = new THREE.Mesh(ball, new THREE.MeshBasicMaterial({ color: colour(issue.holds || i === state.issue ? "--danger" : "--tip-medium"), depthTest: i !== state.issue, transparent: i === state.issue }));
        dot.position.set(issue.place[0], issue.place[1], (issue.layer + 0.5) * (site.view?.layer.thickness_mm || 0.1));
        dot.scale.setScalar(i === state.issue ? 1.8 : 1);
        marks.add(dot);
      });
      draw();
    };
    view = { job: job.id, plan: viewOf(job), renderer, pose, draw, size, cutAt, mark };
    if (site.view) cutAt(site.view.layer);
    mark();
  }

  function turnBy(azimuth, height, zoom = 1) {
    if (!view) return;
    view.pose.azimuth += azimuth;
    view.pose.height = Math.max(-1.5, Math.min(1.5, view.pose.height + height));
    view.pose.distance = Math.max(view.size * 0.5, Math.min(view.size * 10, view.pose.distance * zoom));
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

  // The picture, until somebody wants more; a job that is planned again is another solid.
  function showFlat() {
    const job = chosenJob();
    if (view && job && view.plan === viewOf(job)) return;
    if (asked && asked === job?.id) return;  // it is on its way
    canvas.hidden = true;
    asked = null;
    showPicture(picture, viewOf(job));
    turn.hidden = false;
    turn.disabled = !job?.layers;
    note.textContent = job?.layers ? "" : "not planned yet";
  }

  turn.onclick = async () => {
    const job = chosenJob();
    if (!job?.layers || asked === job.id) return;
    asked = job.id;
    try {
      await loadThree("the 3-D view needs the package libjs-three on the fab machine");
      const solid = await build(job);
      if (!solid) return;
      show(job, solid);
      picture.hidden = turn.hidden = true;
      canvas.hidden = false;
      canvas.focus();
      note.textContent = "drag or use the arrow keys to turn, the wheel or + and - to come nearer; a square of the plate is 10 mm";
    } catch (error) {
      note.textContent = error.message;
    }
    asked = null;
  };
  document.addEventListener("job-chosen", showFlat);
  document.addEventListener("job-shown", showFlat);
  document.addEventListener("layer-drawn", (e) => view && view.job === state.chosen && view.cutAt(e.detail));
  for (const name of ["issues-found", "issue-chosen"]) document.addEventListener(name, () => view && view.job === state.chosen && view.mark());
})();
