// The connection to the watch: opened again whenever it is lost.

const TOKEN = "maquette-token";

/** The first time and the longest time between two attempts, in milliseconds. */
const [SOON, LATE] = [200, 1000];

const RENEWED = "maquette-renewed";

/** The token of the link, which then no longer stands in the address. */
function token() {
  const given = location.hash.slice(1);
  if (/^[0-9a-f]{32}$/.test(given)) {
    sessionStorage.setItem(TOKEN, given);
    history.replaceState(null, "", location.pathname + location.search);
  }
  return sessionStorage.getItem(TOKEN) ?? "";
}

/**
 * Loads the page anew if it is that of another program; what is seen stands in the address. Whatever a program says of its page, it is
 * loaded only once for that.
 * @param {string} [now] what the page of the program is
 */
export function renew(now) {
  const own = document.querySelector("meta[name=page]")?.getAttribute("content");
  if (now === undefined || now === own || now === sessionStorage.getItem(RENEWED)) return;
  sessionStorage.setItem(RENEWED, now);
  location.reload();
}

/**
 * Calls `hear` with each message, and `tell` with the state of the connection (`live` or `lost`) and what to say of it.
 * @param {(message: import("./types").Message) => void} hear
 * @param {(state: "live" | "lost", text: string) => void} tell
 */
export function connect(hear, tell) {
  const secret = token();
  let wait = SOON;
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
      wait = SOON;
      tell("live", "live");
    });
    made.addEventListener("message", (event) => hear(JSON.parse(event.data)));
    made.addEventListener("close", () => {
      tell("lost", wasOpen ? "the watch has ended" : "no watch here: open the link that it prints");
      timer = setTimeout(open, wait);
      wait = Math.min(LATE, 2 * wait);
    });
  }

  document.addEventListener("visibilitychange", () => {
    if (document.visibilityState === "visible") open();
  });
  addEventListener("online", open);
  open();
  return {
    /**
     * Says something, if anybody is there to hear it.
     * @param {import("./types").Wish} message
     */
    send(message) {
      if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
    },
  };
}
