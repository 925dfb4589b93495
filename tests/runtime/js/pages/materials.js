// What materials of every kind show under the light of a bake, and after it has left.
import * as THREE from "three";
import { GsgiLoader } from "/js/three.js";
import { post } from "./post.js";

const renderer = new THREE.WebGLRenderer();
const target = new THREE.WebGLRenderTarget(8, 8, { type: THREE.FloatType });
const camera = new THREE.PerspectiveCamera(40, 1, 0.1, 10);
camera.position.set(0.1, 0.2, 2);

const TEXEL = [60, 170, 210];

/** Radiance in the middle of the picture. */
function shown(scene) {
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);
    const pixel = new Float32Array(4);
    renderer.readRenderTargetPixels(target, 4, 4, 1, 1, pixel);
    return [...pixel.slice(0, 3)];
}

function sceneOf(...objects) {
    const scene = new THREE.Scene();
    scene.add(...objects);
    return scene;
}

const plane = new THREE.PlaneGeometry(4, 4);
const mesh = (material) => new THREE.Mesh(plane, material);

/** A plane whose vertices two bones hold, one of which has moved to the light of the other's place. */
function skinned(material) {
    const geometry = plane.clone();
    const zeros = () => new THREE.BufferAttribute(new Float32Array(16), 4), weights = zeros();
    for (let i = 0; i < 4; ++i) weights.setX(i, 1);
    geometry.setAttribute("skinIndex", zeros()).setAttribute("skinWeight", weights);
    const bone = new THREE.Bone(), made = new THREE.SkinnedMesh(geometry, material);
    made.add(bone);
    made.bind(new THREE.Skeleton([bone]));
    bone.position.set(0.05, 0, 0);
    return made;
}

function instanced(material) {
    const made = new THREE.InstancedMesh(plane, material, 1);
    made.setMatrixAt(0, new THREE.Matrix4().makeTranslation(0.05, 0, 0));
    return made;
}

const kinds = {
    lambert: () => mesh(new THREE.MeshLambertMaterial()),
    phong: () => mesh(new THREE.MeshPhongMaterial({ specular: 0 })),
    toon: () => mesh(new THREE.MeshToonMaterial()),
    standard: () => mesh(new THREE.MeshStandardMaterial({ roughness: 1 })),
    physical: () => mesh(new THREE.MeshPhysicalMaterial({ specularIntensity: 0 })),
    flat: () => mesh(new THREE.MeshLambertMaterial({ flatShading: true, side: THREE.DoubleSide })),
    list: () => {
        const geometry = plane.clone();
        geometry.addGroup(0, Infinity, 0);
        return new THREE.Mesh(geometry, [new THREE.MeshLambertMaterial()]);
    },
    instanced: () => instanced(new THREE.MeshLambertMaterial()),
    skinned: () => skinned(new THREE.MeshLambertMaterial()),
};
await post(async () => {
    const load = (name) => new GsgiLoader().setPath("/files/").loadAsync(name);
    const light = await load("even.gsgi"), found = { kinds: {}, without: {} };
    for (const [name, make] of Object.entries(kinds)) {
        const scene = sceneOf(make(), light);
        found.kinds[name] = shown(scene);
        scene.remove(light);
        found.without[name] = shown(scene);
    }

    // Things that move, whose material says so, also while the light is there.
    const levels = await load("levels.gsgi"), thing = new THREE.MeshLambertMaterial(), hall = sceneOf(mesh(thing), levels);
    found.moves = [false, true, false].map((moves) => {
        thing.userData.gsgiMoves = moves;
        return shown(hall);
    });

    // A material with its own hook, its clones, those that copy the hook, and those added later.
    const own = new THREE.MeshLambertMaterial(), hook = (shader) => {
        shader.fragmentShader = shader.fragmentShader.replace("#include <opaque_fragment>",
            "outgoingLight.b = 0.75;\n#include <opaque_fragment>");
    };
    own.onBeforeCompile = hook;
    const plain = new THREE.MeshLambertMaterial(), scene = sceneOf(mesh(own), light);
    found.hook = shown(scene);
    const copy = own.clone();
    copy.onBeforeCompile = own.onBeforeCompile;
    copy.customProgramCacheKey = own.customProgramCacheKey;
    scene.add(mesh(own.clone()), mesh(copy), mesh(plain), mesh(plain));
    scene.children[0].visible = false;
    const only = (index) => {
        scene.children.forEach((each, i) => { if (each.isMesh) each.visible = i === index; });
        return shown(scene);
    };
    found.clone = only(2);
    found.copiedHook = only(3);
    found.shared = [only(4), only(5)];

    // Intensity and visibility need no new programs.
    const programs = renderer.info.programs.length;
    light.intensity = 2;
    found.doubled = shown(scene);
    light.intensity = 1;
    light.visible = false;
    found.invisible = shown(scene);
    light.visible = true;
    found.newPrograms = renderer.info.programs.length - programs;

    // A second light adds to the first; each leaves by itself, with whatever it is in.
    const other = await load("other.gsgi"), group = new THREE.Group();
    scene.add(group.add(other));
    found.both = shown(scene);
    group.visible = false;
    found.hiddenGroup = shown(scene);
    group.visible = true;
    light.removeFromParent();
    found.second = shown(scene);
    group.removeFromParent();
    found.none = shown(scene);
    found.restored = own.onBeforeCompile === hook && !Object.hasOwn(own, "customProgramCacheKey")
        && !Object.hasOwn(plain, "onBeforeCompile") && !Object.hasOwn(plain, "customProgramCacheKey");
    scene.add(light);
    found.again = shown(scene);
    light.dispose();
    found.disposed = shown(scene);

    // In two scenes that share a material, each light stays in its own.
    const [here, there] = [sceneOf(mesh(plain), await load("even.gsgi")), sceneOf(mesh(plain), other)];
    found.here = [shown(here), shown(there), shown(here)];

    // The bake goes with the object.
    const spot = await load("spot.gsgi"), room = sceneOf(mesh(new THREE.MeshLambertMaterial()), spot);
    found.spot = shown(room);
    spot.position.set(3, 0, 0);
    found.away = shown(room);
    spot.position.set(0, 0, 0);
    spot.rotation.y = Math.PI;
    found.turned = shown(room);
    spot.rotation.y = 0;
    room.add(spot.clone());
    found.cloned = shown(room);

    // Light groups are weighed for the next frame; clones keep their weights, and each light has its own.
    const lamps = await load("groups.gsgi"), dim = sceneOf(mesh(new THREE.MeshLambertMaterial()), lamps);
    const weigh = (weights) => { lamps.weights = weights; return shown(dim); };
    found.groups = [shown(dim), weigh({ lamps: 0.5 }), weigh({ lamps: [1, 0, 0], base: 0 }), weigh({})];
    weigh({ base: 0.25 });
    const twin = lamps.clone();
    dim.remove(lamps).add(twin);
    found.groups.push(shown(dim));
    found.weights = [lamps.weights, twin.weights];
    try {
        lamps.weights = { lamp: 1 };
    } catch (error) {
        found.unknown = `${error}`;
    }

    // Light follows normal maps, on both sides of a material.
    const texel = new THREE.DataTexture(new Uint8Array([...TEXEL, 255]), 1, 1), relief = await load("bumpy.gsgi");
    texel.needsUpdate = true;
    found.bumpy = [plane, plane.clone().rotateY(Math.PI)].map((geometry) => {
        const look = { normalMap: texel, side: THREE.DoubleSide };
        return shown(sceneOf(new THREE.Mesh(geometry, new THREE.MeshLambertMaterial(look)), relief));
    });

    found.errors = [];
    for (const name of ["over.gsgi", "damaged.gsgi", "missing.gsgi"])
        found.errors.push(await load(name).then(() => "", (error) => `${error.name}: ${error.message}`));

    // Files are decoded in a worker, and where there is none all the same.
    const Native = Worker;
    found.fromWorker = [];
    for (const kind of [Native, undefined, class { constructor() { throw new DOMException("another origin"); } }]) {
        let answers = 0;
        globalThis.Worker = kind === Native ? class extends Native {
            constructor(...how) {
                super(...how);
                this.addEventListener("message", ({ data }) => { answers += data.tables.cells.length > 0; });
            }
        } : kind;
        const again = await load("even.gsgi");
        found.fromWorker.push([answers, shown(sceneOf(mesh(new THREE.MeshLambertMaterial()), again))]);
    }
    globalThis.Worker = Native;
    return found;
});
