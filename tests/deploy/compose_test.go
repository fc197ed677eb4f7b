package deploy

import (
	"fmt"
	"os"
	"regexp"
	"slices"
	"strings"
	"testing"

	"sigs.k8s.io/yaml"
)

type service struct {
	ReadOnly    bool     `json:"read_only"`
	CapDrop     []string `json:"cap_drop"`
	CapAdd      []string `json:"cap_add"`
	SecurityOpt []string `json:"security_opt"`
	Privileged  bool     `json:"privileged"`
	Ports       []string `json:"ports"`
	Volumes     []string `json:"volumes"`
	Networks    []string `json:"networks"`
	Command     []string `json:"command"`
	Entrypoint  []string `json:"entrypoint"`
	MemLimit    string   `json:"mem_limit"`

	DependsOn   any               `json:"depends_on"` // a list, or conditions by service
	Environment map[string]string `json:"environment"`
	Build       struct {
		Target string `json:"target"`
	} `json:"build"`
}

type composeFile struct {
	Services map[string]service `json:"services"`
	Networks map[string]*struct {
		Internal bool `json:"internal"`
	} `json:"networks"`
	Volumes map[string]any `json:"volumes"`
}

func readCompose(t *testing.T) composeFile {
	t.Helper()
	var file composeFile
	if err := yaml.Unmarshal([]byte(read(t, "../../deploy/compose/docker-compose.yml")), &file); err != nil {
		t.Fatal(err)
	}
	return file
}

func read(t *testing.T, name string) string {
	t.Helper()
	content, err := os.ReadFile(name)
	if err != nil {
		t.Fatal(err)
	}
	return string(content)
}

func TestComposeServicesAreConfined(t *testing.T) {
	for name, s := range readCompose(t).Services {
		if !s.ReadOnly || s.Privileged || !slices.Equal(s.CapDrop, []string{"ALL"}) || len(s.CapAdd) > 0 ||
			!slices.Contains(s.SecurityOpt, "no-new-privileges:true") {
			t.Errorf("%s is not confined: %+v", name, s)
		}
		for _, port := range s.Ports {
			if !strings.HasPrefix(port, "127.0.0.1:") && !strings.HasPrefix(port, "${METROFARM_ADDRESS:-127.0.0.1}:") {
				t.Errorf("%s listens on every address of the machine: %s", name, port)
			}
		}
	}
}

func TestComposeNamesWhatExists(t *testing.T) {
	file, dockerfile := readCompose(t), read(t, "../../deploy/docker/Dockerfile")
	for name, s := range file.Services {
		if target := s.Build.Target; target != "" && !strings.Contains(dockerfile, " AS "+target+"\n") {
			t.Errorf("%s is built from stage %s, which does not exist", name, target)
		}
		for _, network := range s.Networks {
			if _, declared := file.Networks[network]; !declared {
				t.Errorf("%s joins network %s, which does not exist", name, network)
			}
		}
		for _, volume := range s.Volumes {
			source, _, _ := strings.Cut(volume, ":")
			if _, declared := file.Volumes[source]; !declared && !strings.HasPrefix(source, "/") && !strings.HasPrefix(source, ".") {
				t.Errorf("%s mounts volume %s, which does not exist", name, source)
			}
		}
	}
	for file, pattern := range map[string]string{
		"../../deploy/docker/haproxy.cfg":        `server \S+ ([\w-]+):8080`,
		"../../deploy/prometheus/prometheus.yml": `(coordinator-\d+):8080`,
		"../../deploy/compose/cluster.sh":        `(coordinator-\d+)`,
	} {
		for _, match := range regexp.MustCompile(pattern).FindAllStringSubmatch(read(t, file), -1) {
			if _, exists := readCompose(t).Services[match[1]]; !exists {
				t.Errorf("%s names %s, which is no service", file, match[1])
			}
		}
	}
}

// Scenes are other people's files: whoever opens them reaches the coordinators and nothing else.
func TestComposeKeepsWorkersApart(t *testing.T) {
	file := readCompose(t)
	if networks := file.Services["worker"].Networks; !slices.Equal(networks, []string{"farm"}) {
		t.Errorf("workers are in %v", networks)
	}
	for _, network := range []string{"farm", "store", "control"} {
		if n := file.Networks[network]; n == nil || !n.Internal {
			t.Errorf("network %s leads outside", network)
		}
	}
	for name, s := range file.Services {
		if slices.Contains(s.Networks, "store") && name != "redis" && !strings.HasPrefix(name, "coordinator") {
			t.Errorf("%s reaches Redis", name)
		}
	}
}

// Proxy and monitoring show what is rendered: without them it is rendered all the same.
func TestComposeRendersWithoutWhatOnlyShows(t *testing.T) {
	services := readCompose(t).Services
	for _, name := range []string{"redis", "coordinator-1", "coordinator-2", "worker"} {
		s := services[name]
		text := fmt.Sprint(s.DependsOn, s.Entrypoint, s.Command)
		for _, shows := range []string{"proxy", "prometheus", "grafana"} {
			if _, exists := services[shows]; !exists || strings.Contains(text, shows) {
				t.Errorf("%s needs %s, or there is none: %s", name, shows, text)
			}
		}
	}
	for _, target := range strings.Split(option(t, services["worker"].Command, "--coordinator="), ",") {
		name, _, _ := strings.Cut(target, ":")
		if !strings.HasPrefix(name, "coordinator-") || !slices.Contains(services[name].Networks, "farm") {
			t.Errorf("workers go to %s, which is no coordinator in their network", target)
		}
	}
}

// option of a program, after its prefix.
func option(t *testing.T, words []string, prefix string) string {
	t.Helper()
	for _, word := range words {
		if value, found := strings.CutPrefix(word, prefix); found {
			return value
		}
	}
	t.Fatalf("no %s in %v", prefix, words)
	return ""
}

func TestImagesRunAsNobodyAndTellTheirHealth(t *testing.T) {
	dockerfile := read(t, "../../deploy/docker/Dockerfile")
	stages := regexp.MustCompile(`(?m)^FROM runtime AS (\S+)$`).FindAllStringSubmatchIndex(dockerfile, -1)
	if len(stages) < 5 {
		t.Fatalf("%d images", len(stages))
	}
	for i, at := range stages {
		end := len(dockerfile)
		if i+1 < len(stages) {
			end = stages[i+1][0]
		}
		stage, name := dockerfile[at[0]:end], dockerfile[at[2]:at[3]]
		for _, line := range []string{"\nUSER 10001:10001\n", "\nHEALTHCHECK ", "\nENTRYPOINT ["} {
			if !strings.Contains(stage, line) {
				t.Errorf("image %s has no %s", name, strings.TrimSpace(line))
			}
		}
	}
}
