package cli

import (
	"os"
	"testing"
)

// shares are what a server takes of its memory, in MiB.
type shares struct {
	films, batches, workerFilms, scenes int64
}

func TestServeTakesSharesOfItsMemory(t *testing.T) {
	for name, c := range map[string]struct {
		memoryGiB int64
		arguments []string
		want      shares
	}{
		"alone":        {4, []string{"--workers", "0"}, shares{2048, 512, 1024, 0}},
		"with workers": {8, []string{"--workers", "2"}, shares{2048, 1024, 2048, 2048}},
		"plenty":       {1024, []string{"--workers", "0"}, shares{512 << 10, 1024, 8192, 0}},
		"unknown":      {0, []string{"--workers", "1"}, shares{0, 0, 8192, 0}},
		"as told": {
			4,
			[]string{"--workers", "0", "--films-memory", "300MiB", "--merge-budget", "200MiB", "--max-worker-memory", "100"},
			shares{300, 200, 100, 0},
		},
	} {
		t.Run(name, func(t *testing.T) {
			b := newBench(t, listsScene)
			b.env.Memory = c.memoryGiB << 30
			go func() { b.interrupts <- os.Interrupt }()
			if code := b.run(t, append([]string{"serve", "--data", b.path("data")}, c.arguments...)...); code != 0 {
				t.Fatal(b.stderr.String())
			}
			o := b.farm.options
			got := shares{
				o.Flow.FilmsMemory / mebibyte, o.Flow.MergeBudget / mebibyte,
				int64(o.Access.JobLimits.WorkerBytes / mebibyte), o.SceneMemory / mebibyte,
			}
			if got != c.want {
				t.Errorf("of %d GiB %+v, want %+v", c.memoryGiB, got, c.want)
			}
		})
	}
}
