/** Fly controls: drag to look, W A S D and Q E to move; with two fingers drag to move, pinch to go forward. */

import { Vector3 } from "three";

const KEYS = { KeyW: [0, 0, -1], KeyS: [0, 0, 1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyQ: [0, -1, 0], KeyE: [0, 1, 0] };
const TURN = 0.003; // rad per pixel
const STEEPEST = 1.55; // rad from the horizon

export class FlyControls {
    enabled = false;
    #camera;
    #speed; // m/s
    #changed;
    #keys = new Set();
    #pointers = new Map();

    /** `speed` in m/s; `changed()` hears that the camera has moved or is about to. */
    constructor(camera, element, speed, changed) {
        Object.assign(this, { element });
        this.#camera = camera;
        this.#speed = speed;
        this.#changed = changed;
        element.addEventListener("pointerdown", (event) => this.#pointers.set(event.pointerId, event));
        for (const name of ["pointerup", "pointercancel"])
            addEventListener(name, (event) => this.#pointers.delete(event.pointerId));
        addEventListener("pointermove", (event) => this.#drag(event));
        element.addEventListener("wheel", (event) => this.#move([0, 0, Math.sign(event.deltaY)], 0.25), { passive: true });
        addEventListener("keydown", (event) => {
            if (!this.enabled || !KEYS[event.code] || event.ctrlKey || event.metaKey) return;
            this.#keys.add(event.code);
            changed();
        });
        addEventListener("keyup", (event) => this.#keys.delete(event.code));
        addEventListener("blur", () => this.#keys.clear());
    }

    /** Moves by the keys that are held for `seconds`; returns whether any is. */
    update(seconds) {
        for (const code of this.#keys) this.#move(KEYS[code], seconds);
        return this.enabled && this.#keys.size > 0;
    }

    #move(direction, seconds) {
        if (!this.enabled) return;
        this.#camera.position.add(
            new Vector3(...direction).applyQuaternion(this.#camera.quaternion).multiplyScalar(this.#speed * seconds));
        this.#changed();
    }

    #drag(event) {
        const last = this.#pointers.get(event.pointerId);
        if (!this.enabled || !last) return;
        const x = event.clientX - last.clientX, y = event.clientY - last.clientY;
        if (this.#pointers.size === 1) {
            const { rotation } = this.#camera.rotation.order === "YXZ" ? this.#camera : this.#upright();
            rotation.y += TURN * x;
            rotation.x = Math.min(Math.max(rotation.x + TURN * y, -STEEPEST), STEEPEST);
        } else {
            const [other] = [...this.#pointers.values()].filter(({ pointerId }) => pointerId !== event.pointerId);
            const span = (from) => Math.hypot(from.clientX - other.clientX, from.clientY - other.clientY);
            this.#move([-x / 2, y / 2, 2 * (span(last) - span(event))], 0.01);
        }
        this.#pointers.set(event.pointerId, event);
        this.#changed();
    }

    #upright() {
        this.#camera.rotation.reorder("YXZ");
        this.#camera.rotation.z = 0;
        return this.#camera;
    }
}
