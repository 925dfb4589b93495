// Opens the exported page in a frame of WxH pixels, and reads its picture with each of the settings that are asked for.
// The address: page.html?width=W&height=H&settings=[{"gi": "on"}, ...]&hash=...
import { post } from "./post.js";

const given = Object.fromEntries(new URLSearchParams(location.search));
const frame = document.createElement("iframe");
Object.assign(frame, { src: `/site/index.html#${given.hash ?? ""}`, width: given.width, height: given.height });

/** Pixels of the canvas, RGB, row 0 on top, as base64. */
function picture({ renderer, render }) {
    render();
    const gl = renderer.getContext(), { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
    const pixels = new Uint8Array(4 * width * height), rgb = [];
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    for (let y = height - 1; y >= 0; --y)
        for (let i = 4 * y * width; i < 4 * (y + 1) * width; i += 4)
            rgb.push(String.fromCharCode(pixels[i], pixels[i + 1], pixels[i + 2]));
    return { width, height, rgb: btoa(rgb.join("")) };
}

/** Where the camera goes, and looks, by keys and by a finger. */
async function moves({ camera, set }, { document, PointerEvent, KeyboardEvent }) {
    const canvas = document.getElementById("canvas"), frames = () => new Promise((done) => setTimeout(done, 500));
    const pose = () => {
        camera.updateMatrixWorld();
        const e = camera.matrixWorld.elements;
        return { position: [e[12], e[13], e[14]], ahead: [-e[8], -e[9], -e[10]] };
    };
    const point = (type, clientX, clientY) =>
        canvas.dispatchEvent(new PointerEvent(type, { pointerId: 1, clientX, clientY, bubbles: true, pointerType: "touch" }));
    const found = [pose()];
    set({ controls: "fly" });
    canvas.dispatchEvent(new KeyboardEvent("keydown", { code: "KeyW", bubbles: true }));
    await frames();
    canvas.dispatchEvent(new KeyboardEvent("keyup", { code: "KeyW", bubbles: true }));
    found.push(pose());
    point("pointerdown", 100, 100);
    point("pointermove", 200, 100);
    point("pointerup", 200, 100);
    await frames();
    found.push(pose());
    set({ controls: "orbit" });
    await frames();
    found.push(pose());
    return found;
}

/** How many times the page draws by itself, within ten seconds, once its lost context is back; and its picture then. */
async function restored(gsgi) {
    const canvas = gsgi.renderer.domElement, lost = gsgi.renderer.getContext().getExtension("WEBGL_lose_context");
    const heard = (name) => new Promise((done) => canvas.addEventListener(name, done, { once: true }));
    const gone = heard("webglcontextlost"), back = heard("webglcontextrestored");
    lost.loseContext();
    await gone;
    setTimeout(() => lost.restoreContext(), 0);
    await back;
    const drawn = () => gsgi.renderer.info.render.frame - before, before = gsgi.renderer.info.render.frame;
    for (let i = 0; i < 100 && !drawn(); ++i) await new Promise((done) => setTimeout(done, 100));
    return { drawn: drawn(), picture: picture(gsgi) };
}

await post(async () => {
    document.body.append(frame);
    const page = () => frame.contentDocument?.documentElement?.dataset.loaded;
    const failed = () => frame.contentDocument?.getElementById("error")?.hidden === false;
    while (!page() && !failed()) await new Promise((done) => setTimeout(done, 20));
    if (failed()) return { error: frame.contentDocument.getElementById("error").textContent };
    const { gsgi } = frame.contentWindow, found = { ready: Number(frame.contentDocument.documentElement.dataset.ready), loaded: Number(page()), pictures: [], milliseconds: [] };
    for (const settings of JSON.parse(given.settings)) {
        gsgi.set(settings);
        found.pictures.push(picture(gsgi));
        found.milliseconds.push(gsgi.measure(Number(given.frames ?? 3)));
    }
    if (given.loses) found.restored = await restored(gsgi);
    if (given.moves) found.poses = await moves(gsgi, frame.contentWindow);
    found.groups = [...frame.contentDocument.querySelectorAll("#groups label")].map((each) => each.textContent.trim());
    found.title = frame.contentDocument.title;
    found.about = frame.contentDocument.getElementById("about").textContent;
    found.exposure = gsgi.renderer.toneMappingExposure;
    return found;
});
