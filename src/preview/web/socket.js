// The connection to `maquette watch`, which is opened again whenever it is lost.

const TOKEN = "maquette-token";

/** The minimum and the maximum time between two attempts to connect, in milliseconds. */
const [MIN_WAIT, MAX_WAIT] = [200, 1000];

const RENEWED = "maquette-renewed";

/** Returns the token of the link that `maquette watch` prints, and removes it from the address. */
function token() {
  const given = location.hash.slice(1);
  if (/^[0-9a-f]{32}$/.test(given)) {
    sessionStorage.setItem(TOKEN, given);
    history.replaceState(null, "", location.pathname + location.search);
  }
  return sessionStorage.getItem(TOKEN) ?? "";
}

/**
 * Reloads the page if the program that runs now has another version of the page. The view is kept, since it is part of the address. Each
 * version causes at most one reload.
 * @param {string} [now] the version of the program's page
 */
export function renew(now) {
  const own = document.querySelector("meta[name=page]")?.getAttribute("content");
  if (now === undefined || now === own || now === sessionStorage.getItem(RENEWED)) return;
  sessionStorage.setItem(RENEWED, now);
  location.reload();
}

/**
 * Calls `receive` with each message, and `report` with each state of the connection (`live` or `lost`) and a text for the user.
 * @param {(message: import("./types").Message) => void} receive
 * @param {(state: "live" | "lost", text: string) => void} report
 */
export function connect(receive, report) {
  const secret = token();
  let wait = MIN_WAIT;
  let timer = 0;
  /** @type {WebSocket | null} */
  let socket = null;

  function open() {
    clearTimeout(timer);
    if (socket !== null && socket.readyState <= WebSocket.OPEN) return;
    const made = new WebSocket(`ws://${location.host}/socket`, ["maquette", secret]);
    socket = made;
    let wasOpen = false;
    made.addEventListener("open", () => {
      wasOpen = true;
      wait = MIN_WAIT;
      report("live", "live");
    });
    made.addEventListener("message", (event) => receive(JSON.parse(event.data)));
    made.addEventListener("close", () => {
      report("lost", wasOpen ? "maquette watch has ended" : "cannot connect: open the link that maquette watch prints");
      timer = setTimeout(open, wait);
      wait = Math.min(MAX_WAIT, 2 * wait);
    });
  }

  document.addEventListener("visibilitychange", () => {
    if (document.visibilityState === "visible") open();
  });
  addEventListener("online", open);
  open();
  return {
    /**
     * Sends a message if the connection is open.
     * @param {import("./types").Request} message
     */
    send(message) {
      if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
    },
  };
}
