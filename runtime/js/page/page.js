/** The exported page: one scene, its baked light, and controls. */

import * as THREE from "three";
import { GsgiLoader } from "gsgi/three";
import { FlyControls } from "./fly.js";
import { buildScene, fetchBytes, onlyIndirect } from "./scene.js";

const MID_GREY = 0.18; // what the log-average luminance is exposed to
const METERED = 64; // px, of the frame that exposure goes by
const WEIGHT_MAX = 1e15; // of a light group
const element = (id) => document.getElementById(id);

/** Says on the page why nothing is to be seen. */
function fail(message) {
    element("error").textContent = message;
    element("error").hidden = false;
    element("loading").hidden = element("bar").hidden = true;
}

function createRenderer() {
    const canvas = element("canvas");
    const gl = canvas.getContext("webgl2", { antialias: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("This page needs WebGL 2, which this browser does not offer or has turned off.");
    if (!gl.getExtension("EXT_color_buffer_float"))
        throw new Error("This page needs float textures that can be drawn to (EXT_color_buffer_float), which this device lacks.");
    const renderer = new THREE.WebGLRenderer({ canvas, context: gl });
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.toneMapping = THREE.NeutralToneMapping;
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = THREE.PCFShadowMap;
    renderer.shadowMap.autoUpdate = false; // nothing moves
    renderer.shadowMap.needsUpdate = true;
    renderer.autoClear = false;
    return renderer;
}

/** Reads everything beside the page; shows how much of it has come. */
async function load() {
    const description = JSON.parse(await (await fetchBytes("scene.json")).text());
    let loaded = 0;
    const progress = (bytes) => { element("bar").value = (loaded += bytes) / description.bytes; };
    const fetchOne = (name) => fetchBytes(name, progress);
    document.title = description.title;
    const data = fetchOne(description.data), bytes = await (await fetchOne(description.light)).arrayBuffer();
    const reading = new GsgiLoader().parseAsync(bytes); // in a worker, while this thread waits for a context
    const renderer = createRenderer(), built = await buildScene(description, data, fetchOne, renderer);
    drawShadows(renderer, built.scene);
    const light = await reading;
    light.position.set(...description.origin).negate();
    built.scene.add(light);
    return { renderer, description, light, ...built };
}

/** Draws the shadow maps, and brings the triangles to the GPU: all that needs no baked light. */
function drawShadows(renderer, scene) {
    scene.overrideMaterial = new THREE.MeshBasicMaterial({ colorWrite: false });
    renderer.render(scene, new THREE.PerspectiveCamera());
    scene.overrideMaterial = null;
}

/** A slider for the weight of a light group; `change(weight)` hears of it. */
function groupSlider(name, change) {
    const slider = Object.assign(document.createElement("input"), { type: "range", min: 0, max: 2, step: 0.05, value: 1 });
    const label = document.createElement("label");
    label.append(`${name} `, slider);
    element("groups").append(label);
    slider.addEventListener("input", () => change(Number(slider.value)));
    return slider;
}

/** The exposure that shows the frame's log-average luminance as mid-grey (Reinhard et al. 2002). */
function autoExposure(renderer, renderRadiance) {
    const target = new THREE.WebGLRenderTarget(METERED, METERED, { type: THREE.FloatType });
    const pixels = new Float32Array(4 * METERED * METERED);
    renderRadiance(target);
    renderer.readRenderTargetPixels(target, 0, 0, METERED, METERED, pixels);
    target.dispose();
    let sum = 0, count = 0;
    for (let i = 0; i < pixels.length; i += 4) {
        const luminance = 0.2126 * pixels[i] + 0.7152 * pixels[i + 1] + 0.0722 * pixels[i + 2];
        if (!(luminance > 0 && luminance < Infinity)) continue;
        sum += Math.log(luminance);
        count += 1;
    }
    return count ? MID_GREY / Math.exp(sum / count) : 1;
}

/** Linear light to draw into, and what brings it to the screen: blending is of light, before the tone curve. */
function createDeveloped() {
    const target = new THREE.WebGLRenderTarget(1, 1, { type: THREE.HalfFloatType, samples: 4 });
    const material = new THREE.ShaderMaterial({
        uniforms: { radiance: { value: target.texture } },
        vertexShader: `
            out vec2 at;
            void main() {
                gl_Position = vec4( position.xy, 0.0, 1.0 );
                at = 0.5 + 0.5 * position.xy;
            }`,
        fragmentShader: `
            uniform sampler2D radiance;
            in vec2 at;
            void main() {
                gl_FragColor = vec4( texture( radiance, at ).rgb, 1.0 );
                #include <tonemapping_fragment>
                #include <colorspace_fragment>
            }`,
        depthTest: false, depthWrite: false,
    });
    const quad = new THREE.Mesh(new THREE.PlaneGeometry(2, 2), material);
    quad.frustumCulled = false;
    return { target, quad };
}

function start({ renderer, description, light, scene, depth, blended, dim, unshadowed }) {
    const camera = new THREE.PerspectiveCamera(), canvas = renderer.domElement, sky = scene.getObjectByName("sky");
    const [low, high] = description.bounds.map((corner) => new THREE.Vector3(...corner));
    const size = low.distanceTo(high);
    const developed = createDeveloped();
    let wanted = true, then = 0, milliseconds = 0, automatic = 1;
    const draw = () => { wanted = true; };

    let later = null;
    const drawSoon = () => { later ??= setTimeout(() => { later = null; draw(); }, 1000); }; // for many small changes

    const orbit = new THREE.OrbitControls(camera, canvas);
    orbit.addEventListener("change", draw);
    const fly = new FlyControls(camera, canvas, size / 10, draw);

    /**
     * Settings as the address names them: #camera=NAME&gi=on|off|only&exposure=X&controls=orbit|fly, and weight.NAME=X
     * for each light group, here by name in `weights`.
     */
    const settings = { camera: description.cameras[0].name, gi: "on", exposure: null, controls: "orbit", weights: {} };
    const sliders = Object.fromEntries(description.groups.map((name) => [name, groupSlider(name, (value) =>
        set({ weights: { ...settings.weights, [name]: value } }))]));

    function weigh() {
        const weights = Object.fromEntries(description.groups.map((name) => [name, settings.weights[name] ?? 1]));
        if (description.groups.every((name) => weights[name] === light.weights[name])) return;
        light.weights = weights;
        dim(weights);
        for (const name of description.groups) sliders[name].value = weights[name];
    }

    function apply() {
        onlyIndirect.value = settings.gi === "only";
        light.visible = settings.gi !== "off";
        weigh();
        for (const each of [...blended, sky]) if (each) each.visible = settings.gi !== "only";
        renderer.toneMappingExposure = settings.exposure ?? automatic;
        const turning = settings.controls === "orbit";
        if (turning && !orbit.enabled) aim();
        orbit.enabled = turning;
        fly.enabled = !turning;
        for (const name of ["camera", "gi", "controls"]) element(name).value = settings[name];
        element("exposure").value = Math.log2(renderer.toneMappingExposure / automatic);
        draw();
    }

    function place(name) {
        const found = description.cameras.find((each) => each.name === name) ?? description.cameras[0];
        new THREE.Matrix4().fromArray(found.worldFromView).decompose(camera.position, camera.quaternion, camera.scale);
        camera.fov = found.yfov * 180 / Math.PI;
        camera.near = found.znear;
        camera.far = found.zfar ?? 4 * size + camera.position.distanceTo(low);
        settings.camera = found.name;
        aim();
        resize();
    }

    /** Lets the camera turn around a point ahead, as far away as the scene's middle. */
    function aim() {
        const middle = low.clone().add(high).multiplyScalar(0.5), ahead = camera.getWorldDirection(new THREE.Vector3());
        const distance = Math.max(middle.sub(camera.position).dot(ahead), size / 20);
        orbit.target.copy(camera.position).addScaledVector(ahead, distance);
    }

    function resize() {
        renderer.setSize(innerWidth, innerHeight, false);
        developed.target.setSize(canvas.width, canvas.height);
        camera.aspect = innerWidth / innerHeight;
        camera.updateProjectionMatrix();
        draw();
    }

    function render() {
        renderRadiance(developed.target);
        renderer.setRenderTarget(null);
        renderer.render(developed.quad, camera);
    }

    function renderRadiance(target) {
        renderer.setRenderTarget(target);
        renderer.clear();
        renderer.render(depth, camera);
        renderer.render(scene, camera);
    }

    /** Milliseconds of a frame, the median of `count`, each waited for. */
    function measure(count = 9) {
        const pixel = new Uint8Array(4), gl = renderer.getContext(), times = [];
        for (let i = 0; i < count; ++i) {
            const begin = performance.now();
            render();
            gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
            times.push(performance.now() - begin);
        }
        return times.sort((a, b) => a - b)[count >> 1];
    }

    function set(changes) {
        Object.assign(settings, changes);
        if (changes.camera !== undefined) place(changes.camera);
        apply();
    }

    function read() {
        const given = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
        const exposure = Number(given.exposure);
        if ("exposure" in given) given.exposure = exposure > 0 ? exposure : null;
        given.weights = {};
        for (const name of description.groups) {
            const weight = Number(given[`weight.${name}`] ?? 1);
            if (weight >= 0 && weight <= WEIGHT_MAX) given.weights[name] = weight;
        }
        set({ ...given, camera: given.camera ?? settings.camera });
    }

    function frame(now) {
        const seconds = Math.min((now - then) / 1000, 0.1), moving = fly.update(seconds);
        if (orbit.enabled) orbit.update();
        if (wanted || moving) {
            wanted = false;
            render();
            // Frames that follow each other: the time between them is what one takes.
            if (now - then < 1000) milliseconds += ((now - then) - milliseconds) / 8;
            element("time").textContent = milliseconds ? `${milliseconds.toFixed(0)} ms` : "";
        }
        then = now;
        requestAnimationFrame(frame);
    }

    for (const { name } of description.cameras) element("camera").add(new Option(name, name));
    for (const name of ["camera", "gi", "controls"])
        element(name).addEventListener("change", (event) => set({ [name]: event.target.value }));
    element("exposure").addEventListener("input", (event) => set({ exposure: automatic * 2 ** event.target.value }));
    element("about").textContent = description.about + (unshadowed ? ` ${unshadowed} lights throw no shadows here.` : "");
    addEventListener("resize", resize);
    addEventListener("hashchange", read);
    canvas.addEventListener("webglcontextrestored", () => { renderer.shadowMap.needsUpdate = true; draw(); });
    place(settings.camera);
    apply();
    automatic = autoExposure(renderer, renderRadiance);
    read();
    requestAnimationFrame(frame);
    /** Resolves once the first frame has been drawn. */
    const shown = new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)));
    return { shown, renderer, scene, camera, light, settings, set, drawSoon, render, measure };
}

try {
    const loaded = await load(), page = start(loaded);
    element("loading").hidden = true;
    element("panel").hidden = false;
    document.documentElement.dataset.ready = Math.round(performance.now()); // ms since the address was opened
    window.gsgi = page; // for the console, and for tests
    await page.shown;
    await loaded.loadImages(page.drawSoon);
    element("bar").hidden = true;
    loaded.renderer.shadowMap.needsUpdate = true; // holes that images cut
    page.render();
    document.documentElement.dataset.loaded = Math.round(performance.now());
} catch (error) {
    fail(error.message);
    throw error;
}
