// What was, to go back to: one step each time something is kept.
export class Undo<T> {
  private readonly past: T[] = [];
  private readonly future: T[] = [];

  constructor(private readonly restore: (state: T) => void) {}

  /** Call with the state before a change. */
  step(before: T): void {
    this.past.push(before);
    if (this.past.length > 100) this.past.shift();
    this.future.length = 0;
  }

  back(now: T): void {
    const state = this.past.pop();
    if (state === undefined) return;
    this.future.push(now);
    this.restore(state);
  }

  again(now: T): void {
    const state = this.future.pop();
    if (state === undefined) return;
    this.past.push(now);
    this.restore(state);
  }
}

/** One thing after the other: what is saved and what is read again must not overtake each other. */
export class Turns {
  /** Raised by changes from elsewhere: what was made on an older state is refused, not mixed in. */
  foreign = 0;
  private last: Promise<unknown> = Promise.resolve();

  take(act: () => Promise<void>): Promise<void> {
    const next = this.last.then(act);
    this.last = next.catch(() => undefined);
    return next;
  }

  /** Save a change in its turn, unless somebody else's came first. */
  save(act: () => Promise<void>): Promise<void> {
    const seen = this.foreign;
    return this.take(async () => {
      if (seen !== this.foreign) throw new Error("someone else has changed this in the meantime");
      await act();
    });
  }
}

/** Do the last thing asked for only: what is asked while another is under way waits, and gives way to the next. */
export class Latest {
  private busy = false;
  private waiting: (() => Promise<void>) | null = null;

  async ask(act: () => Promise<void>): Promise<void> {
    if (this.busy) {
      this.waiting = act;
      return;
    }
    this.busy = true;
    try {
      await act();
    } finally {
      this.busy = false;
      const next = this.waiting;
      this.waiting = null;
      if (next) await this.ask(next);
    }
  }
}
