/** An add-on for three.js (WebGLRenderer): the light of a .gsgi file on every lit material of a scene. */

import {
    DataTexture, FileLoader, FloatType, Matrix4, Object3D, RGBAFormat, RedIntegerFormat, UnsignedIntType, UnsignedShortType,
} from "three";
import { lookupSource, recolour, shCounts } from "./lookup.js";
import { groupNames, weighted } from "./weights.js";

const LIT = ["Standard", "Lambert", "Phong", "Toon"]; // materials; physical ones are standard ones
const CHUNK = "#include <lights_fragment_begin>";

/** Loads .gsgi files: `scene.add(await new GsgiLoader().loadAsync("room.gsgi"))`. */
export class GsgiLoader extends FileLoader {
    responseType = "arraybuffer";

    /** Calls onLoad(light) with an IndirectLight; errors go to onError. */
    load(url, onLoad, onProgress, onError) {
        const fail = (error) => {
            error.message = `${url}: ${error.message}`;
            (onError ?? console.error)(error);
            this.manager.itemError(url);
        };
        const parse = (data) => {
            this.manager.itemStart(url);
            this.parseAsync(data).then(onLoad).catch(fail).finally(() => this.manager.itemEnd(url));
        };
        super.load(url, parse, onProgress, onError);
    }

    /**
     * The IndirectLight in the bytes of a file, an ArrayBuffer, read in a worker, so that the page goes on, and where
     * that cannot be had here. Throws FormatError, and RangeError for `over`.
     */
    async parseAsync(data) {
        const made = (await inWorker(data).catch(() => {})) ?? (await import("./prepare.js")).prepare(data);
        return new IndirectLight(made.bake, made.tables);
    }
}

/** What worker.js makes of the bytes of a file; undefined where it fails. */
function inWorker(data) {
    return new Promise((resolve) => {
        const worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
        worker.onmessage = worker.onerror = (event) => {
            event.preventDefault();
            worker.terminate();
            resolve(event.data);
        };
        worker.postMessage(data);
    });
}

/**
 * The light of a bake. While it is in a scene, all standard, physical, Lambert, Phong and toon materials of the meshes
 * there show it: those that are shared, cloned or added later too, and those that have an onBeforeCompile of their own.
 * Those with `userData.gsgiMoves` are of what moves, and was not in the scene when it was baked: close to a wall the others
 * have the light of the wall.
 *
 * `intensity` is a factor, and `visible` turns it off, without compiling anything; `weights` are factors on the light of
 * each light group that the file has: `light.weights = { lamps: 0.2, sun: [1, 0.9, 0.8] }`. The bake moves, turns and grows with
 * the object. Removing it from the scene, or dispose(), leaves all materials as they were. Throws RangeError for a bake
 * of the `over` operator. `tables` are those that lookupTables() makes of the bake; the light keeps and changes them.
 */
export class IndirectLight extends Object3D {
    type = "IndirectLight";
    intensity = 1;
    #uniforms;
    #tables;
    #weights;
    #lit = new Set(); // materials that show the light
    #ancestors = [];
    #leave = () => this.#release();

    constructor(bake, tables) {
        super();
        this.bake = bake;
        this.#tables = tables;
        this.#weights = ones(bake);
        const { width, gaussians, cells, lists } = tables;
        const texture = (data, channels, format, type, internalFormat) => {
            const made = new DataTexture(data, width, data.length / (width * channels), format, type);
            return Object.assign(made, { internalFormat, needsUpdate: true });
        };
        const integers = (data) => texture(data, 1, RedIntegerFormat,
            data.BYTES_PER_ELEMENT > 2 ? UnsignedIntType : UnsignedShortType, `R${8 * data.BYTES_PER_ELEMENT}UI`);
        this.#uniforms = {
            gaussians: texture(gaussians, 4, RGBAFormat, FloatType, "RGBA32F"),
            cells: integers(cells),
            lists: integers(lists),
            from_world: new Matrix4(),
            intensity: 1,
        };
    }

    /** The weight of each light group of the file: a number, or three of linear Rec.709. */
    get weights() {
        return { ...this.#weights };
    }

    /** Sets weights from the next frame on, 1 for groups that are left out. Throws RangeError for an unknown group. */
    set weights(weights) {
        recolour(this.#tables, weighted(this.bake, weights));
        this.#weights = { ...ones(this.bake), ...weights };
        this.#uniforms.gaussians.needsUpdate = true;
    }

    updateMatrixWorld(force) {
        super.updateMatrixWorld(force);
        this.update();
    }

    /** Bring the scene's materials up to date. Each render() does; call it yourself before renderer.compile(). */
    update() {
        this.#follow();
        const root = this.#ancestors.at(-1);
        if (!root) return;
        this.#uniforms.from_world.copy(this.matrixWorld).invert();
        const seen = this.visible && this.#ancestors.every((object) => object.visible);
        this.#uniforms.intensity = seen ? this.intensity : 0;
        const left = this.#lit;
        this.#lit = new Set();
        root.traverse((object) => {
            if (!object.isMesh) return;
            for (const material of [object.material].flat())
                if (material && LIT.some((kind) => material[`isMesh${kind}Material`])) this.#lit.add(material);
        });
        for (const material of this.#lit) {
            left.delete(material);
            Patch.of(material).show(this, root);
        }
        for (const material of left) Patch.of(material).hide(this);
    }

    /** Leave the scene, and free the GPU memory. */
    dispose() {
        this.removeFromParent();
        this.#release();
        for (const value of Object.values(this.#uniforms)) value.dispose?.();
    }

    clone(recursive) {
        const tables = { ...this.#tables, gaussians: this.#tables.gaussians.slice() };
        const made = new this.constructor(this.bake, tables).copy(this, recursive);
        made.#weights = this.#weights;
        return made;
    }

    copy(source, recursive) {
        super.copy(source, recursive);
        this.intensity = source.intensity;
        return this;
    }

    /** What materials need to show the light. */
    get look() {
        return { shCounts: shCounts(this.bake), uniforms: this.#uniforms, root: this.#ancestors.at(-1) };
    }

    /** Listens to the removal of the light and of what it is in. */
    #follow() {
        const found = [];
        for (let object = this.parent; object; object = object.parent) found.push(object);
        if (found.length === this.#ancestors.length && found.every((object, i) => object === this.#ancestors[i])) return;
        this.#release();
        this.#ancestors = found;
        for (const object of [this, ...found]) object.addEventListener("removed", this.#leave);
    }

    #release() {
        for (const object of [this, ...this.#ancestors]) object.removeEventListener("removed", this.#leave);
        for (const material of this.#lit) Patch.of(material).hide(this);
        this.#ancestors = [];
        this.#lit.clear();
    }
}

/** The weights with which a bake is read. */
function ones(bake) {
    return Object.fromEntries(groupNames(bake).map((name) => [name, 1]));
}

const patches = new WeakMap(); // by material; kept, as three.js keeps programs that refer to their uniforms
const replaced = new WeakMap(); // by a function of ours, that which it stands for

/** The change to one material, and the lights that it shows. */
class Patch {
    #material;
    #lights = [];
    #slots = []; // uniforms of each light
    #renderers = new Set();
    #hook; // the material's onBeforeCompile while it shows a light
    #moves; // whether it is that of things that move
    #undo = [];

    static of(material) {
        if (!patches.has(material)) patches.set(material, new Patch(material));
        return patches.get(material);
    }

    constructor(material) {
        this.#material = material;
    }

    /** Shows `light` in the frame of the scene `root` that is about to be drawn. */
    show(light, root) {
        const known = this.#lights.includes(light), moves = !!this.#material.userData.gsgiMoves;
        if (!known) this.#lights.push(light);
        const changed = !known || moves !== this.#moves || this.#material.onBeforeCompile !== this.#hook;
        this.#moves = moves;
        if (changed) this.#install();
        this.#lights.forEach((each, i) => {
            const { uniforms, root: home } = each.look, slot = (this.#slots[i] ??= {});
            for (const name in uniforms) (slot[name] ??= {}).value = uniforms[name];
            if (home !== root) slot.intensity.value = 0;
        });
        // A program that three.js has kept is used with the uniforms of the one that was compiled last.
        if (changed)
            for (const { properties } of this.#renderers) this.#bind(properties.get(this.#material).uniforms ?? {});
    }

    #bind(uniforms) {
        this.#slots.forEach((slot, i) => {
            for (const name in slot) uniforms[`gsgi${i}_${name}`] = slot[name];
        });
    }

    hide(light) {
        this.#lights = this.#lights.filter((each) => each !== light);
        for (const slot of this.#slots.slice(this.#lights.length))
            for (const name in slot) slot[name].value = null;
        this.#restore();
        if (this.#lights.length) this.#install();
    }

    #install() {
        this.#restore();
        const material = this.#material, lights = this.#lights.map((light) => light.look.shCounts);
        const own = { value: original(material.onBeforeCompile) };
        this.#hook = (shader, renderer) => {
            own.value.call(material, shader, renderer);
            this.#renderers.add(renderer);
            this.#bind(shader.uniforms);
            this.#inject(shader, lights);
        };
        this.#undo = [
            override(material, "onBeforeCompile", () => this.#hook),
            override(material, "customProgramCacheKey", (before) => () =>
                `${before.call(Object.create(material, { onBeforeCompile: own }))} gsgi ${lights} ${this.#moves}`),
        ];
        material.needsUpdate = true;
    }

    #restore() {
        for (const undo of this.#undo) undo();
        this.#undo = [];
        this.#material.needsUpdate = true;
    }

    #inject(shader, lights) {
        if (!shader.fragmentShader.includes(CHUNK)) {
            console.warn(`gsgi: no light on ${this.#material.name}: its shader has no ${CHUNK}`);
            return;
        }
        // B belongs to the normal before any normal map, and may follow the map. Three.js divides irradiance by pi,
        // which B has behind it.
        let functions = "";
        let sum = `vec4 gsgi_x=vec4(((vec4(-vViewPosition,1)-viewMatrix[3])*viewMatrix).xyz,1),
gsgi_n=vec4(nonPerturbedNormal,0)*viewMatrix,gsgi_m=vec4(normal,0)*viewMatrix;`;
        lights.forEach((counts, i) => {
            const own = `gsgi${i}_`, world = `${own}from_world`, intensity = `${own}intensity`;
            functions += `${lookupSource(counts, own)}uniform mat4 ${world};uniform float ${intensity};\n`;
            const [read, flat] = this.#moves ? ["_free", ""] : ["", `mat3(${world})*gsgi_n.xyz,`];
            sum += `if(${intensity}>0.)irradiance+=PI*${intensity}*
${own}indirect${read}((${world}*gsgi_x).xyz,${flat}mat3(${world})*gsgi_m.xyz);`;
        });
        shader.fragmentShader = shader.fragmentShader
            .replace("void main() {", `${functions}void main() {`)
            .replace(CHUNK, `${CHUNK}\n${sum}`);
    }
}

/** Puts `make(before)` in the place of a method; returns what undoes that, unless another one has been set meanwhile. */
function override(material, name, make) {
    const own = Object.hasOwn(material, name), before = original(material[name]), hook = make(before);
    replaced.set(hook, before);
    material[name] = hook;
    return () => {
        if (material[name] !== hook) return;
        if (own) material[name] = before;
        else delete material[name];
    };
}

/** A function that is not ours: some hosts copy onBeforeCompile from one material to another. */
function original(hook) {
    while (replaced.has(hook)) hook = replaced.get(hook);
    return hook;
}
