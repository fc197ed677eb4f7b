package cli

import (
	"strings"
	"testing"
)

const looksAtScene = `test "$1" = inspect || exit 3
echo '{"width": 64, "height": 48, "filter": "FILTER_TENT", "sensor": "thinlens", "max_depth": -1,
 "shapes": {"mesh": 2, "sphere": 1}, "triangles": "12", "lights": [{"kind": "area", "place": "scene.xml:7"}],
 "memory_bytes": "2097152", "warnings": ["scene.xml:9: odd"]}'`

func TestInspect(t *testing.T) {
	b := newBench(t, looksAtScene)
	if code := b.run(t, "inspect", b.scene); code != exitOK {
		t.Fatalf("exit %d: %s", code, b.stderr.String())
	}
	for _, want := range []string{
		"64 x 48, filter tent", "thinlens", "depth unlimited", "2 mesh, 1 sphere", "12 triangles",
		"light    area  scene.xml:7", "warning  scene.xml:9: odd", "2.0 MiB",
	} {
		if !strings.Contains(b.stdout.String(), want) {
			t.Errorf("no %q in:\n%s", want, b.stdout.String())
		}
	}
}

func TestInspectReportsTheScenesFault(t *testing.T) {
	b := newBench(t, `echo "scene.xml:3: unknown plugin" >&2; exit 1`)
	if code := b.run(t, "inspect", b.scene); code != exitFailure {
		t.Errorf("exit %d", code)
	}
	if !strings.Contains(b.stderr.String(), "scene.xml:3: unknown plugin") {
		t.Errorf("stderr %q", b.stderr.String())
	}
}
