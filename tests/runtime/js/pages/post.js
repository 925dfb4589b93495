// Calls `run` and posts what it returns to the test, or the error that it throws.
export async function post(run) {
    let result;
    try {
        result = await run();
    } catch (error) {
        result = { error: `${error}\n${error.stack}` };
    }
    await fetch("/result", { method: "POST", body: JSON.stringify(result) });
}
